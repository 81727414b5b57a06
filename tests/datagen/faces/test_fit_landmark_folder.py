"""Annotated photographs become coefficients: the way suits the annotation, bad ones are named, figures hold."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from datagen.cli import main
from datagen.faces.fit_landmark_folder import AnnotatedFaceFitter, AnnotatedFolder, relative_residual
from pix2face.errors import DegenerateGeometryError, SampleRejectedError
from pix2face.face_files.annotations import AnnotatedFace
from pix2face.face_files.coefficients import load_coefficients
from pix2face.fitting.from_landmarks import LandmarkModel
from pix2face.fitting.jaw_contour import JAW
from pix2face.geometry.camera import HeadPose, WeakPerspective, head_pose, rotation_of_pose, weak_perspective_camera
from pix2face.geometry.landmarks import IBUG68_2D
from pix2face.models.morphable_model import builtin_model, load_model
from tests.model_files import write_small_head
from tests.pix2face.face_files.test_annotations import write_pts
from tests.synthetic_models import small_head_model

MODEL = small_head_model()


def annotated(seed: int = 0, yaw_deg: float = 20) -> AnnotatedFace:
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=len(MODEL.identity_basis) + len(MODEL.expression_basis)).clip(-2, 2)
    camera = weak_perspective_camera(WeakPerspective(1.2, rotation_of_pose(HeadPose(0, yaw_deg, 0)), np.full(2, 150.0)))
    points = camera.project(LandmarkModel.of(MODEL).landmarks3d(coefficients))
    return AnnotatedFace(image_path=Path("face.png"), landmarks2d=points)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three good faces and one whose points are noise."""
    folder = tmp_path / "photographs"
    for seed in range(3):
        write_pts(folder / f"face{seed}.pts", annotated(seed).landmarks2d + 0.5)
    write_pts(folder / "noise.pts", np.random.default_rng(9).uniform(0, 300, (68, 2)))
    for path in folder.glob("*.pts"):
        cv2.imwrite(str(path.with_suffix(".png")), np.zeros((310, 320, 3), np.uint8))
    return folder


def test_a_folder_becomes_faces_with_their_photographs(folder: Path) -> None:
    source = AnnotatedFolder(folder, MODEL)
    assert source.sample_ids == ("face0", "face1", "face2", "noise")
    for index in range(3):
        face = source.face(index)
        assert (face.height_px, face.width_px) == (310, 320)
        assert face.image_path == folder / f"face{index}.png"
        assert abs(head_pose(face.camera).yaw_deg - 20) < 6
        assert float(face.attributes["residual_percent"]) < 2
        assert face.attributes["geometry"] == "fitted to annotated points, jaw along the outline"
    with pytest.raises(SampleRejectedError, match="noise: expected points of a face, found a median residual of"):
        source.face(3)


def test_a_folder_is_told_from_one_with_files_of_other_sizes(folder: Path) -> None:
    first = AnnotatedFolder(folder, MODEL).sha256
    assert AnnotatedFolder(folder, MODEL).sha256 == first
    hashes = {first}
    for name in ("face1.pts", "face2.png"):
        with (folder / name).open("ab") as file:
            file.write(b"\n")
        hashes.add(AnnotatedFolder(folder, MODEL).sha256)
    assert len(hashes) == 3


def test_jaw_points_slide_only_where_they_follow_the_outline() -> None:
    fitter = AnnotatedFaceFitter.of(MODEL)
    by_hand = annotated(yaw_deg=45)
    depths = np.zeros(68)
    surface = replace(by_hand, follows_outline=False, depths_px=depths)
    assert not np.array_equal(*jaw_points(fitter.fit(by_hand)))
    fit = fitter.fit(replace(surface, depths_px=None))
    assert np.array_equal(*jaw_points(fit))
    assert (fit.trust == 1).all()


def test_points_that_people_mark_have_vertices_of_their_own() -> None:
    model = builtin_model()
    fitter = AnnotatedFaceFitter.of(model)
    camera = weak_perspective_camera(WeakPerspective(1.2, rotation_of_pose(HeadPose(0, 0, 0)), np.full(2, 150.0)))
    points = camera.project(model.mean[model.landmarks[IBUG68_2D]].astype(float))
    marked = AnnotatedFace(image_path=Path("face.png"), landmarks2d=points)
    by_hand, projected = (
        relative_residual(fitter.fit(each), each) for each in (marked, replace(marked, follows_outline=False))
    )
    assert by_hand < 0.3 * projected


def jaw_points(fit) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]
    return fit.landmarks2d[list(JAW)], fit.matched2d[list(JAW)]


def test_points_in_another_order_are_refused() -> None:
    face = annotated()
    shuffled = replace(face, landmarks2d=np.random.default_rng(0).permutation(face.landmarks2d))
    with pytest.raises(DegenerateGeometryError, match="68 iBUG points in their order"):
        AnnotatedFaceFitter.of(MODEL).fit(shuffled)


def test_the_command_writes_a_table_and_says_what_is_missing(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model_path = write_small_head(tmp_path / "model.h5")
    out = tmp_path / "faces.h5"
    arguments = ["fit", "--landmarks", str(folder), "--out", str(out), "--model", str(model_path), "--workers", "1"]
    assert main(arguments) == 3
    assert "3 faces ->" in capsys.readouterr().err
    table = load_coefficients(out)
    assert table.sample_ids == ("face0", "face1", "face2")
    assert table.model_sha256 == load_model(model_path).sha256
    assert table.image_paths == ("photographs/face0.png", "photographs/face1.png", "photographs/face2.png")
    assert [name for name, _ in table.rejected] == ["noise"]


@pytest.mark.parametrize(
    ("name", "n", "largest_mean"), [("300w", 30, 0.018), ("dlib_faces", 43, 0.018), ("300vw", 4, 0.018)]
)
def test_hand_annotated_photographs_are_followed_and_none_is_refused(
    shared_dir: Path, name: str, n: int, largest_mean: float
) -> None:
    source = AnnotatedFolder(shared_dir / "data" / name, builtin_model())
    faces = [source.face(index) for index in range(len(source.sample_ids))]
    assert len(faces) == n
    assert np.mean([float(face.attributes["residual_percent"]) for face in faces]) < 100 * largest_mean
    rms = [np.sqrt((np.concatenate([face.identity, face.expression]) ** 2).mean()) for face in faces]
    assert max(rms) < 1.5
