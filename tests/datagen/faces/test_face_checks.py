"""Annotations that people have: missing points are missing, and what cannot be a face is refused with its cause."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io
from numpy import ndarray
from PIL import Image
from PIL.Image import Exif

from datagen.faces.face_checks import check_face
from datagen.faces.fit_landmark_folder import AnnotatedFolder
from datagen.faces.sources import TableSource, W300LPFolder
from pix2face.errors import InputFileError, SampleRejectedError
from pix2face.face_files.annotations import find_annotations
from pix2face.face_files.coefficients import Face, FaceCoefficients, save_coefficients
from pix2face.face_files.w300lp import LANDMARK_CENTRE_MM, PoseParameters, camera_of_pose
from pix2face.fitting.from_landmarks import LandmarkModel
from pix2face.geometry.believable_face import GIVEN
from pix2face.geometry.camera import (
    HeadPose,
    WeakPerspective,
    angle_between_poses_deg,
    head_pose,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.geometry.landmarks import MIRROR_IBUG68
from pix2face.models.morphable_model import builtin_model
from tests.pix2face.face_files.test_annotations import write_pts

HEIGHT_PX, WIDTH_PX = 300, 280
POSE = HeadPose(-4.0, 18.0, 6.0)
Change = Callable[[ndarray], ndarray]


def face_points(pose: HeadPose = POSE, seed: int = 0) -> ndarray:
    """68 points of a face of the built-in model, as a person sets them, counted from 1."""
    model, rng = LandmarkModel.of(builtin_model()), np.random.default_rng(seed)
    camera = weak_perspective_camera(WeakPerspective(0.9, rotation_of_pose(pose), np.array([130.0, 140.0])))
    points = camera.project(model.landmarks3d(0.7 * rng.normal(size=len(model.basis))))
    return np.asarray(points + rng.normal(0, 0.8, (68, 2)) + 0.5)


def annotated(folder: Path, points: ndarray, orientation: int = 1) -> AnnotatedFolder:
    folder.mkdir(exist_ok=True)
    write_pts(folder / "face.pts", points)
    tags = Exif()
    tags[274] = orientation
    size = (WIDTH_PX, HEIGHT_PX) if orientation < 5 else (HEIGHT_PX, WIDTH_PX)
    Image.new("RGB", size).save(folder / "face.jpg", exif=tags)
    return AnnotatedFolder(folder, builtin_model())


def marked(marker: tuple[float, float], chosen: list[int]) -> Change:
    def change(points: ndarray) -> ndarray:
        points[chosen] = marker
        return points

    return change


JAW_AND_BROW = [*range(9), *range(17, 22)]


@pytest.mark.parametrize("marker", [(-1, -1), (0, 0), (np.nan, np.nan), (-1, HEIGHT_PX + 2), (1e5, 20)])
@pytest.mark.parametrize("chosen", [[30], JAW_AND_BROW])
def test_missing_points_are_missing_and_the_rest_is_fitted(
    tmp_path: Path, marker: tuple[float, float], chosen: list[int]
) -> None:
    face = annotated(tmp_path, marked(marker, chosen)(face_points())).face(0)
    assert angle_between_poses_deg(head_pose(face.camera), POSE) < 6
    assert np.abs(np.concatenate([face.identity, face.expression])).max() < 5
    assert float(face.attributes["residual_percent"]) < 1.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p[list(MIRROR_IBUG68)], r"looks 1\d\d° away .*order of a mirrored picture \(left and right"),
        (lambda p: np.column_stack([p[:, 0], HEIGHT_PX - p[:, 1]]), r"looks 1\d\d° away .*does y grow upwards"),
        (lambda p: p[:, ::-1], r"looks 1\d\d° away .*are x and y swapped\?"),
        (lambda p: p / [WIDTH_PX, HEIGHT_PX], r"expected points of a face in pixels.*divided by the size"),
        (lambda p: 2 * p / [WIDTH_PX, HEIGHT_PX] - 1, "expected points of a face in pixels|at least 34 of the 68"),
        (lambda p: 2 * p, r"of 68 outside; was the picture resized or cropped after annotation\?"),
        (lambda p: np.roll(p, 1, axis=0), "nobody has its coefficients .*in their order"),
        (lambda p: p.T.reshape(68, 2), "nobody has its coefficients .*in their order"),
        (lambda p: np.tile(p[30], (68, 1)), "found all of them within 0 x 0 pixels"),
        (marked((-1, -1), list(range(40))), "at least 34 of the 68 points of a face, found 28"),
    ],
)
def test_points_that_make_no_face_are_refused_with_the_likely_cause(
    tmp_path: Path, change: Change, message: str
) -> None:
    source = annotated(tmp_path, change(face_points()))
    with pytest.raises(SampleRejectedError, match=message) as caught:
        source.face(0)
    assert str(caught.value).startswith("face: ")


@pytest.mark.parametrize("yaw_deg", [-75, -50, 50, 75])
def test_profiles_are_told_from_mirrored_ones(tmp_path: Path, yaw_deg: float) -> None:
    """Of a face seen exactly from the side, both orders are nearly the same."""
    points = face_points(HeadPose(0, yaw_deg, 0))
    assert abs(head_pose(annotated(tmp_path, points).face(0).camera).yaw_deg - yaw_deg) < 10
    with pytest.raises(SampleRejectedError, match="away from the camera"):
        annotated(tmp_path, points[list(MIRROR_IBUG68)]).face(0)


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_points_refer_to_the_picture_that_viewers_show(tmp_path: Path, orientation: int) -> None:
    points = face_points()
    face = annotated(tmp_path / "upright", points, orientation).face(0)
    assert (face.height_px, face.width_px) == (HEIGHT_PX, WIDTH_PX)
    assert angle_between_poses_deg(head_pose(face.camera), POSE) < 6
    x, y = points.T
    stored = {3: (WIDTH_PX - x, HEIGHT_PX - y), 6: (y, WIDTH_PX - x), 8: (HEIGHT_PX - y, x)}[orientation]
    with pytest.raises(SampleRejectedError, match=f"orientation tag {orientation}.*do these refer to the stored"):
        annotated(tmp_path / "stored", np.column_stack(stored), orientation).face(0)


def write_posed_mat(path: Path, height_px: int, transposed: bool = False) -> None:
    """A file of AFLW2000-3D whose landmarks lie where its pose puts them in a picture of this height."""
    pose = PoseParameters(head=POSE, translation_px=np.array([130.0, 160.0, 0.0]), scale=0.9e-3)
    model = LandmarkModel.of(builtin_model())
    points = model.mean - model.mean.mean(axis=0) + LANDMARK_CENTRE_MM
    camera = camera_of_pose(pose, height_px)
    points3d = np.column_stack([camera.project(points) + 0.5, -0.9 * camera.depth(points)])
    angles = np.radians([POSE.pitch_deg, POSE.yaw_deg, POSE.roll_deg])
    fields = {"Shape_Para": np.zeros((199, 1)), "Exp_Para": np.zeros((29, 1)), "Illum_Para": np.zeros((1, 10))}
    pose_para = np.array([[*angles, *pose.translation_px, pose.scale]])
    points3d = points3d if transposed else points3d.T
    scipy.io.savemat(path, {**fields, "Pose_Para": pose_para, "pt3d_68": points3d})


@pytest.mark.parametrize("transposed", [False, True])
def test_a_mat_file_goes_with_a_picture_of_its_size(tmp_path: Path, transposed: bool) -> None:
    write_posed_mat(tmp_path / "face.mat", HEIGHT_PX, transposed)
    for source in (AnnotatedFolder, W300LPFolder):
        cv2.imwrite(str(tmp_path / "face.png"), np.zeros((HEIGHT_PX, WIDTH_PX, 3), np.uint8))
        face = source(tmp_path, builtin_model()).face(0)
        assert angle_between_poses_deg(head_pose(face.camera), POSE) < 3
        cv2.imwrite(str(tmp_path / "face.png"), np.zeros((256, 256, 3), np.uint8))
        with pytest.raises(SampleRejectedError, match=r"256 pixels height.*was the picture resized"):
            source(tmp_path, builtin_model()).face(0)


def table_face(folder: Path, **changes: object) -> Face:
    face = annotated(folder, face_points()).face(0)
    return replace(face, **changes)  # type: ignore[arg-type]


def wrong_faces(face: Face) -> dict[str, Face]:
    turned = face.camera.matrix @ np.diag([-1.0, 1.0, -1.0, 1.0])
    moved = np.array([[1.0, 0, 300], [0, 1, 0], [0, 0, 1]])
    return {
        "looks 1": replace(face, camera=type(face.camera)(turned)),
        "nobody has its coefficients": replace(face, identity=face.identity + np.float32(8)),
        "outside of the picture": replace(face, camera=face.camera.transformed(moved)),
    }


def test_tables_of_before_are_checked_when_they_are_rendered(tmp_path: Path) -> None:
    face, model = table_face(tmp_path), builtin_model()
    for message, wrong in {"": face, **wrong_faces(face)}.items():
        save_table(tmp_path / "table.h5", wrong, "face.jpg")
        source = TableSource(tmp_path / "table.h5", model)
        if not message:
            assert source.face(0).sample_id == "face"
            continue
        with pytest.raises(SampleRejectedError, match=f"face: .*{message}"):
            source.face(0)
        save_table(tmp_path / "drawn.h5", wrong, "")  # faces that are drawn may be anything
        assert TableSource(tmp_path / "drawn.h5", model).face(0).image_path is None


def save_table(path: Path, face: Face, image_path: str) -> None:
    model = builtin_model()
    table = FaceCoefficients(
        model_name=model.name,
        model_sha256=model.sha256,
        sample_ids=("face",),
        identity=face.identity[None],
        expression=face.expression[None],
        cameras=face.camera.matrix[None],
        sizes_px=np.array([[face.height_px, face.width_px]], dtype=np.int32),
        image_paths=(image_path,),
    )
    save_coefficients(table, path)


def test_a_model_without_landmarks_is_checked_as_far_as_possible(tmp_path: Path) -> None:
    face = table_face(tmp_path)
    wrong = wrong_faces(face)
    check_face(wrong["outside of the picture"], None, GIVEN)
    with pytest.raises(SampleRejectedError, match="nobody has"):
        check_face(wrong["nobody has its coefficients"], None, GIVEN)


def test_no_good_file_is_refused(shared_dir: Path) -> None:
    source = W300LPFolder(shared_dir / "data" / "aflw2000_3d" / "dev", builtin_model())
    for index in range(0, len(source.sample_ids), 4):
        source.face(index)


def test_the_folders_of_strangers(shared_dir: Path) -> None:
    """Each annotation is fitted as the good one, or refused."""
    folder = shared_dir / "trouble" / "pts"
    if not folder.is_dir():
        pytest.skip("needs ../shared/trouble")
    source, found = AnnotatedFolder(folder, builtin_model()), {}
    for index, name in enumerate(source.sample_ids):
        try:
            found[name] = source.face(index).camera
        except SampleRejectedError:
            found[name] = None
    good = found["good"]
    assert good is not None
    fitted = {name for name, camera in found.items() if camera is not None}
    assert fitted == {"good", "half_minus1", "half_zero", "one_minus1", "exif6"}
    for name in fitted:
        assert angle_between_poses_deg(head_pose(found[name]), head_pose(good)) < 4


def test_the_loader_itself_refuses_points_outside(tmp_path: Path) -> None:
    """So every reader of annotated folders does, not only the one that fits."""
    annotated(tmp_path, 3 * face_points())
    (annotation,) = find_annotations(tmp_path)
    with pytest.raises(InputFileError, match="outside"):
        annotation.load()
