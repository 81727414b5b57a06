"""Where faces come from: with BFM 2009 the files' own coefficients, else fits to their landmarks, else a table."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy import ndarray

from datagen.faces.sources import TableSource, W300LPFolder, open_source
from datagen.sampling.faces import sample_faces
from pix2face.errors import InputFileError, SampleRejectedError, UsageError
from pix2face.face_files.annotations import picture_beside
from pix2face.face_files.coefficients import save_coefficients
from pix2face.face_files.w300lp import read_coefficient_file
from pix2face.model_formats.bfm2009 import PUBLISHED_BASIS
from pix2face.models.morphable_model import MorphableModel
from tests.keypoint_model import points_of_pose
from tests.pix2face.benchmark_files import write_mat
from tests.synthetic_models import small_head_model

HEIGHT_PX, WIDTH_PX = 90, 120
IDENTITY_UNIT, EXPRESSION_UNIT = np.linspace(1e5, 1e6, 199), np.linspace(0.2, 2, 29)
POSE = np.array([[0.1, -0.4, 0.2, 61, 44, 0, 4e-4]], dtype=np.float32)


@pytest.fixture(scope="module")
def bfm() -> MorphableModel:
    """The small head with as many components as BFM 2009, and its name for them."""
    head, rng = small_head_model(), np.random.default_rng(0)
    return replace(
        head,
        identity_basis=rng.normal(size=(199, *head.mean.shape)).astype(np.float32),
        expression_basis=rng.normal(size=(29, *head.mean.shape)).astype(np.float32),
        named_expressions={},
        published_basis=PUBLISHED_BASIS,
        identity_unit=IDENTITY_UNIT,
        expression_unit=EXPRESSION_UNIT,
    )


def write_file(folder: Path, name: str = "face", pose: ndarray = POSE, suffix: str = ".jpg") -> dict[str, ndarray]:
    rng = np.random.default_rng(1)
    fields = {"Shape_Para": rng.normal(0, 3e5, (199, 1)), "Exp_Para": rng.normal(size=(29, 1)), "Pose_Para": pose}
    write_mat(folder / f"{name}.mat", np.zeros((68, 2)), 0.0, **fields)
    cv2.imwrite(str(folder / f"{name}{suffix}"), np.full((HEIGHT_PX, WIDTH_PX, 3), 80, np.uint8))
    return fields


@pytest.mark.parametrize("sign", [1, -1])
def test_with_bfm_the_coefficients_of_the_files_are_the_geometry(
    tmp_path: Path, bfm: MorphableModel, sign: int
) -> None:
    pose = POSE * np.array([1, 1, 1, 1, 1, 1, sign], dtype=np.float32)
    fields = write_file(tmp_path, pose=pose)
    face = W300LPFolder(tmp_path, bfm).face(0)
    np.testing.assert_allclose(face.identity * IDENTITY_UNIT, fields["Shape_Para"][:, 0], rtol=1e-5)
    np.testing.assert_allclose(face.expression * EXPRESSION_UNIT, fields["Exp_Para"][:, 0], rtol=1e-5)
    assert (face.height_px, face.width_px) == (HEIGHT_PX, WIDTH_PX)
    assert face.image_path == tmp_path / "face.jpg"
    undone = ", negative scale undone" if sign < 0 else ""
    assert face.attributes == {"geometry": f"coefficients of the file{undone}"}
    # The published formula, in the authors' 1-based pixels, is the oracle of the camera.
    points_mm = bfm.mean[::100].astype(np.float64)
    posed = points_of_pose(1000 * points_mm, read_coefficient_file(tmp_path / "face.mat").pose, HEIGHT_PX)
    np.testing.assert_allclose(face.camera.project(points_mm), posed[:, :2] - 0.5, atol=1e-6)
    nearer = np.argsort(face.camera.depth(points_mm))
    np.testing.assert_array_equal(nearer, np.argsort(-sign * posed[:, 2]))


def test_ids_are_paths_below_the_folder_in_order(tmp_path: Path, bfm: MorphableModel) -> None:
    for name in ("b/two", "a/three", "one", "a/b.c"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_file(tmp_path, name)
    (tmp_path / "landmarks").mkdir()
    write_file(tmp_path, "landmarks/none")
    write_file(tmp_path, "one_pts")
    assert W300LPFolder(tmp_path, bfm).sample_ids == ("a/b.c", "a/three", "b/two", "one")


@pytest.mark.parametrize("suffix", [".png", ".JPG", ".bmp"])
def test_pictures_of_other_kinds_are_found(tmp_path: Path, bfm: MorphableModel, suffix: str) -> None:
    write_file(tmp_path, suffix=suffix)
    assert W300LPFolder(tmp_path, bfm).face(0).image_path == picture_beside(tmp_path / "face.mat")
    assert picture_beside(tmp_path / "face.mat").name == f"face{suffix}"


def test_a_picture_that_is_no_ordinary_file_is_rejected(tmp_path: Path, bfm: MorphableModel) -> None:
    write_file(tmp_path)
    (tmp_path / "face.jpg").unlink()
    (tmp_path / "face.jpg").symlink_to("/dev/zero")
    with pytest.raises(SampleRejectedError, match=r"face\.jpg"):
        W300LPFolder(tmp_path, bfm).face(0)


def test_a_source_is_told_from_another_of_its_name(tmp_path: Path) -> None:
    model = small_head_model()
    hashes = set()
    for seed, n in ((0, 3), (1, 3), (0, 4)):
        table = sample_faces(model, n, seed, 64)
        for changed in (table, replace(table, identity=table.identity + np.float32(1))):
            save_coefficients(changed, tmp_path / "faces.h5")
            hashes.add(TableSource(tmp_path / "faces.h5", model).sha256)
    assert len(hashes) == 6
    write_file(tmp_path, "a")
    first = open_source(tmp_path, model).sha256
    assert open_source(tmp_path, model).sha256 == first
    picture = (tmp_path / "a.jpg").read_bytes()
    (tmp_path / "a.jpg").write_bytes(picture + b"\0")
    other_picture = open_source(tmp_path, model).sha256
    (tmp_path / "a.jpg").unlink()
    no_picture = open_source(tmp_path, model).sha256
    (tmp_path / "a.jpg").write_bytes(picture)
    assert open_source(tmp_path, model).sha256 == first  # a copy, whatever its time
    file = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(file + b"\0")
    other_file = open_source(tmp_path, model).sha256
    (tmp_path / "a.mat").write_bytes(file)
    write_file(tmp_path, "b")
    assert len({first, other_picture, no_picture, other_file, open_source(tmp_path, model).sha256}) == 5


def test_what_a_table_says_of_a_face_tells_it_from_another(tmp_path: Path) -> None:
    """Attributes go into shards as they are."""
    model, hashes = small_head_model(), set()
    table = sample_faces(model, 2, 0, 64)
    for attributes in (('{"a": 1}', "{}"), ('{"a": 2}', "{}")):
        save_coefficients(replace(table, attributes=attributes), tmp_path / "faces.h5")
        hashes.add(TableSource(tmp_path / "faces.h5", model).sha256)
    assert len(hashes) == 2


def test_landmarks_that_a_model_is_fitted_to_tell_a_folder_from_another(tmp_path: Path, bfm: MorphableModel) -> None:
    write_file(tmp_path, "a")
    landmarks = tmp_path / "landmarks" / "a_pts.mat"
    landmarks.parent.mkdir()
    fitted, own = set(), set()
    for content in (None, b"some", b"others"):
        if content is not None:
            landmarks.write_bytes(content)
        fitted.add(open_source(tmp_path, small_head_model()).sha256)
        own.add(open_source(tmp_path, bfm).sha256)
    assert (len(fitted), len(own)) == (3, 1)  # BFM takes the coefficients of the files


def test_a_place_without_faces_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"expected \.mat files of 300W-LP"):
        open_source(tmp_path, small_head_model())
    with pytest.raises(UsageError, match="found nothing there"):
        open_source(tmp_path / "nothing", small_head_model())
    (tmp_path / "text").write_text("no table")
    with pytest.raises(InputFileError, match="expected a table of coefficients"):
        open_source(tmp_path / "text", small_head_model())
