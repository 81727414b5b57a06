"""Retargeting: which landmarks are used, and how well faces of BFM become faces of the built-in model."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io
from numpy import ndarray

from datagen.faces.retarget import Retargeter
from datagen.faces.sources import W300LPFolder
from pix2face.errors import SampleRejectedError
from pix2face.face_files.coefficients import Face
from pix2face.face_files.w300lp import CoefficientFile, camera_of_pose, read_coefficient_file
from pix2face.geometry.camera import HeadPose
from pix2face.models.morphable_model import builtin_model
from tests.keypoint_model import KeypointModel, fit_keypoint_model

pytestmark = pytest.mark.xdist_group("retargeting")  # the copies are written once

SIZE_PX = 450
YAWS_OF_COPIES = (None, 40.0, 65.0, 85.0)


def write_copy(path: Path, file: CoefficientFile, pt2d: ndarray | None, **fields: object) -> None:
    """Writes a coefficient file with its (grey) picture, as 300W-LP lays it out: 1-based, Matlab's shapes."""
    head = file.pose.head
    angles = np.radians([head.pitch_deg, head.yaw_deg, head.roll_deg])
    values: dict[str, object] = {
        "Shape_Para": file.identity[:, None],
        "Exp_Para": file.expression[:, None],
        "Pose_Para": np.concatenate([angles, file.pose.translation_px, [file.pose.scale]])[None],
    }
    if pt2d is not None:
        values["pt2d"] = pt2d.T + 0.5
    scipy.io.savemat(path, values | fields)
    cv2.imwrite(str(path.with_suffix(".jpg")), np.full((SIZE_PX, SIZE_PX, 3), 99, np.uint8))


def turned(file: CoefficientFile, keypoints_mm: ndarray, yaw_deg: float | None) -> CoefficientFile:
    """The file with its head turned to another yaw about the centre of its landmarks, as a profiled copy has it."""
    if yaw_deg is None:
        return file
    head = HeadPose(
        file.pose.head.pitch_deg, float(np.copysign(yaw_deg, file.pose.head.yaw_deg)), file.pose.head.roll_deg
    )
    pose = replace(file.pose, head=head)
    centre = keypoints_mm.mean(axis=0, keepdims=True)
    moved = camera_of_pose(file.pose, SIZE_PX).project(centre) - camera_of_pose(pose, SIZE_PX).project(centre)
    translation = pose.translation_px + np.array([moved[0, 0], -moved[0, 1], 0])
    return replace(file, pose=replace(pose, translation_px=translation))


@pytest.fixture(scope="module")
def dev(shared_dir: Path) -> Path:
    return shared_dir / "data" / "aflw2000_3d" / "dev"


@pytest.fixture(scope="module")
def keypoint_model(dev: Path) -> KeypointModel:
    return fit_keypoint_model(dev)


@pytest.fixture(scope="module")
def family(
    dev: Path, keypoint_model: KeypointModel, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, ndarray]]:
    """Twelve source photographs with three profiled copies each, and where the landmarks of each copy really are."""
    folder, truth = tmp_path_factory.mktemp("family"), {}
    sources = [read_coefficient_file(path) for path in sorted(dev.glob("*.mat"))]
    frontal = [file for file in sources if abs(file.pose.head.yaw_deg) < 30 and abs(file.pose.head.roll_deg) < 40][:12]
    for file in frontal:
        keypoints = keypoint_model.keypoints_mm(file)
        source_pixels = camera_of_pose(file.pose, SIZE_PX).project(keypoints)
        for number, yaw in enumerate(YAWS_OF_COPIES):
            copy, name = turned(file, keypoints, yaw), f"{file.path.stem}_{number}"
            # pt2d is that of the source in every copy.
            write_copy(folder / f"{name}.mat", copy, source_pixels)
            truth[name] = camera_of_pose(copy.pose, SIZE_PX).project(keypoints)
    return folder, truth


def relative_errors(faces: list[Face], truth: dict[str, ndarray]) -> ndarray:
    """Mean distance of the 68 landmarks over sqrt(w h) of the true box, for each face."""
    model = builtin_model()
    errors = []
    for face in faces:
        vertices = model.vertices(face.identity[None], face.expression[None])[0]
        found = face.camera.project(vertices[model.landmarks["ibug68"]])
        true = truth[face.sample_id]
        errors.append(np.linalg.norm(found - true, axis=1).mean() / np.sqrt(np.prod(np.ptp(true, axis=0))))
    return np.array(errors)


def test_copies_take_the_face_of_their_source_and_their_own_pose(family: tuple[Path, dict[str, ndarray]]) -> None:
    folder, truth = family
    source = W300LPFolder(folder, builtin_model())
    faces = [source.face(index) for index in range(len(source.sample_ids))]
    copies = [face for face in faces if not face.sample_id.endswith("_0")]
    originals = [face for face in faces if face.sample_id.endswith("_0")]
    assert len(copies) == 36
    for face in copies:
        own = next(other for other in originals if other.sample_id[:-2] == face.sample_id[:-2])
        np.testing.assert_array_equal(face.identity, own.identity)
        np.testing.assert_array_equal(face.expression, own.expression)
    assert relative_errors(originals, truth).mean() < 0.02
    assert relative_errors(copies, truth).mean() < 0.05
    assert relative_errors(copies, truth).max() < 0.10


def test_the_own_pt2d_of_a_copy_would_be_wrong(family: tuple[Path, dict[str, ndarray]]) -> None:
    """What the rule is for: fitted to the pt2d that it carries, a copy misses its landmarks by far."""
    folder, truth = family
    retargeter = Retargeter(builtin_model(), folder)
    faces = []
    for path in sorted(folder.glob("*_3.mat")):
        file = replace(read_coefficient_file(path), path=path.with_name("alone.mat"))
        identity, expression, camera, way = retargeter.fit(file, SIZE_PX)
        assert way == "fitted to pt2d"
        faces.append(
            Face(
                sample_id=path.stem,
                identity=identity,
                expression=expression,
                camera=camera,
                height_px=SIZE_PX,
                width_px=SIZE_PX,
            )
        )
    assert relative_errors(faces, truth).min() > 0.15


def test_the_landmarks_folder_comes_before_pt2d(family: tuple[Path, dict[str, ndarray]], tmp_path: Path) -> None:
    folder, truth = family
    name = sorted(truth)[3]
    (tmp_path / "AFW").mkdir()
    (tmp_path / "landmarks" / "AFW").mkdir(parents=True)
    for suffix in (".mat", ".jpg"):
        (tmp_path / "AFW" / f"{name}{suffix}").write_bytes((folder / f"{name}{suffix}").read_bytes())
    points = {"pts_3d": truth[name] + 0.5, "pts_2d": np.zeros((68, 2))}
    scipy.io.savemat(tmp_path / "landmarks" / "AFW" / f"{name}_pts.mat", points)
    for root in (tmp_path, tmp_path / "AFW"):
        source = W300LPFolder(root, builtin_model())
        face = source.face(0)
        assert face.attributes["geometry"] == "fitted to the landmarks folder"
        assert relative_errors([replace(face, sample_id=name)], truth)[0] < 0.02


def test_a_copy_without_landmarks_or_sibling_is_rejected(
    family: tuple[Path, dict[str, ndarray]], tmp_path: Path
) -> None:
    folder, truth = family
    name = sorted(truth)[2]
    for suffix in (".mat", ".jpg"):
        (tmp_path / f"{name}{suffix}").write_bytes((folder / f"{name}{suffix}").read_bytes())
    with pytest.raises(SampleRejectedError, match="neither a landmarks folder nor"):
        W300LPFolder(tmp_path, builtin_model()).face(0)


def test_a_file_without_any_landmarks_is_rejected(dev: Path, tmp_path: Path) -> None:
    write_copy(tmp_path / "face_0.mat", read_coefficient_file(min(dev.glob("*.mat"))), None)
    with pytest.raises(SampleRejectedError, match="expected pt3d_68, a landmarks folder, or pt2d"):
        W300LPFolder(tmp_path, builtin_model()).face(0)


def test_the_file_of_300wlp_as_distributed(shared_dir: Path) -> None:
    source = W300LPFolder(shared_dir / "data" / "300wlp", builtin_model())
    face = source.face(0)
    file = read_coefficient_file(shared_dir / "data" / "300wlp" / "IBUG_image_008_1_0.mat")
    assert file.landmarks2d is not None
    assert relative_errors([face], {face.sample_id: file.landmarks2d})[0] < 0.03
