"""BFM 2009 at full size: its real mean with smooth random bases, written in every layout and read back.

The real bases need a licence. What can go wrong on the way in (unit, scaling, winding, the mean expression, order of
columns, trimming) can go wrong with any bases.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy import ndarray

from pix2face.errors import InputFileError, ModelMismatchError
from pix2face.face_files.w300lp import camera_of_pose, read_coefficient_file
from pix2face.geometry.camera import Camera
from pix2face.geometry.landmarks import IBUG68, INNER51
from pix2face.model_formats import read_model
from pix2face.model_formats.bfm2009 import (
    GUO_BASIS,
    NEUTRAL_BASIS,
    PUBLISHED_BASIS,
    inner_mouth_vertices,
    standard_deviations_of_300wlp,
)
from pix2face.model_formats.model_import import import_model
from pix2face.models.model_file import StoredModel, write_stored_model
from pix2face.models.morphable_model import load_model
from tests.published_models import Head, write_bfm, write_guo, write_original_bfm

pytestmark = pytest.mark.xdist_group("full size")  # the model is written and read once
N_ORIGINAL, N_TRIMMED, N_IDENTITY, N_EXPRESSION = 53490, 53215, 199, 29


@dataclass(frozen=True)
class FullSize:
    """What the shared files say, and a head of that size."""

    head: Head
    expression_mean: ndarray
    keypoints: ndarray
    trim: ndarray


def smooth_basis(mean: ndarray, count: int, seed: int) -> ndarray:
    """Waves over the head, in mm, single precision."""
    rng = np.random.default_rng(seed)
    phases = (mean @ (rng.normal(size=(count, 3, 1)) / 60))[..., 0] + rng.uniform(0, 2 * np.pi, (count, 1))
    amplitudes = rng.normal(0, 1, (count, 1, 3)) * np.linspace(3, 0.1, count)[:, None, None]
    return (np.sin(phases)[..., None] * amplitudes).astype(np.float32)


@pytest.fixture(scope="module")
def full_size(shared_dir: Path) -> FullSize:
    folder = shared_dir / "models" / "bfm_mean"
    info = scipy.io.loadmat(folder / "model_info.mat")
    neutral, offset = (np.load(folder / f"{name}.npy").reshape(-1, 3) / 1000.0 for name in ("u_shp", "u_exp"))
    mean = neutral + offset
    triangles = info["tri"].T.astype(np.int64)[:, [0, 2, 1]] - 1
    head = Head(mean, smooth_basis(mean, N_IDENTITY, 1), smooth_basis(mean, N_EXPRESSION, 2), triangles)
    keypoints = np.load(folder / "keypoints_sim.npy")[::3] // 3
    return FullSize(head, offset, keypoints, info["trimIndex"].ravel().astype(np.int64) - 1)


@pytest.fixture(scope="module")
def imported_path(full_size: FullSize, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The layout of 300W-LP through import into the project's file."""
    folder = tmp_path_factory.mktemp("bfm")
    write_bfm(folder, full_size.head, full_size.keypoints, expression_mean=full_size.expression_mean, dtype=np.float32)
    write_stored_model(import_model(folder).model, folder / "bfm.h5")
    for path in folder.glob("*.mat"):
        path.unlink()
    return folder / "bfm.h5"


def untrimmed(full_size: FullSize, basis_count: int) -> Head:
    """The original's 53,490 vertices: inside the mouth, where the shared mean has none, all at one place."""
    shapes = []
    for rows in (full_size.head.mean[None], full_size.head.identity[:basis_count]):
        whole = np.zeros((len(rows), N_ORIGINAL, 3))
        whole[:, full_size.trim] = rows
        shapes.append(whole)
    return Head(shapes[0][0], shapes[1], shapes[1][:0], full_size.trim[full_size.head.triangles])


def test_vertices_are_the_published_formula(full_size: FullSize, imported_path: Path) -> None:
    model = load_model(imported_path)
    assert (len(model.mean), model.n_identity, model.n_expression) == (N_TRIMMED, N_IDENTITY, N_EXPRESSION)
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=N_IDENTITY), rng.normal(size=N_EXPRESSION)
    found = model.vertices(a[None], b[None])[0]
    np.testing.assert_allclose(found, full_size.head.vertices(a, b), atol=1e-3)


def test_coefficients_of_the_files_are_divided_by_the_stored_deviations(imported_path: Path) -> None:
    units = standard_deviations_of_300wlp(load_model(imported_path))
    assert units is not None
    np.testing.assert_allclose(units[0], np.linspace(9e5, 1e5, N_IDENTITY))
    np.testing.assert_allclose(units[1], np.linspace(2, 0.2, N_EXPRESSION))


def test_unit_extent_and_winding_are_those_of_the_conventions(imported_path: Path) -> None:
    model = load_model(imported_path)
    np.testing.assert_allclose(model.mean.min(axis=0), [-90, -122, -15], atol=8)
    np.testing.assert_allclose(model.mean.max(axis=0), [90, 89, 133], atol=8)
    corners = model.mean[model.triangles].astype(np.float64)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("tc,tc->t", outward, corners.mean(axis=1)) > 0).mean() > 0.95
    assert model.smallest_radius_mm == pytest.approx(66, abs=1.5)


def posed_landmark_error_px(stored: StoredModel, camera: Camera, truth: ndarray) -> float:
    places = camera.project(stored.mean[stored.landmarks[IBUG68]].astype(np.float64))
    return float(np.linalg.norm(places - truth, axis=1)[list(INNER51)].mean())


@pytest.fixture(scope="module")
def photograph(shared_dir: Path) -> tuple[Camera, ndarray]:
    """Camera and true landmarks of the one file of 300W-LP at hand."""
    file = read_coefficient_file(shared_dir / "data" / "300wlp" / "IBUG_image_008_1_0.mat")
    assert file.landmarks2d is not None
    return camera_of_pose(file.pose, 450), file.landmarks2d


def test_another_unit_or_a_forgotten_mean_expression_would_be_seen(
    full_size: FullSize, photograph: tuple[Camera, ndarray], tmp_path: Path
) -> None:
    """The checks above can fail: the same faces with one thing wrong."""
    small = replace(full_size.head, identity=full_size.head.identity[:2], expression=full_size.head.expression[:2])
    write_bfm(tmp_path, small, full_size.keypoints, expression_mean=full_size.expression_mean)
    right = read_model(tmp_path)
    assert 6.9 <= posed_landmark_error_px(right, *photograph) <= 7.0
    without = replace(right, mean=(right.mean - full_size.expression_mean).astype(np.float32))
    assert not 6.9 <= posed_landmark_error_px(without, *photograph) <= 7.0
    write_bfm(tmp_path, replace(small, mean=small.mean / 1000), full_size.keypoints)
    with pytest.raises(InputFileError, match="the unit or the landmarks are wrong"):
        import_model(tmp_path)
    # Wound the other way, the same polygons come out.
    write_bfm(tmp_path, small, full_size.keypoints, expression_mean=full_size.expression_mean, inward=False)
    np.testing.assert_array_equal(
        np.sort(read_model(tmp_path).polygons[:, :3], axis=1), np.sort(right.polygons[:, :3], axis=1)
    )


def test_the_original_alone_has_all_vertices_and_no_expressions(full_size: FullSize, tmp_path: Path) -> None:
    head = untrimmed(full_size, 5)
    stored = import_model(write_original_bfm(tmp_path, head)).model
    assert (len(stored.mean), len(stored.identity_basis), len(stored.expression_basis)) == (N_ORIGINAL, 5, 0)
    np.testing.assert_allclose(stored.mean, head.mean, atol=1e-3)
    np.testing.assert_allclose(stored.identity_basis, head.identity, atol=1e-3)
    np.testing.assert_array_equal(stored.landmarks[IBUG68], full_size.trim[full_size.keypoints])
    write_stored_model(stored, tmp_path / "a.h5")
    with pytest.raises(ModelMismatchError, match=f"{PUBLISHED_BASIS}.*0 expression components.*{NEUTRAL_BASIS}"):
        standard_deviations_of_300wlp(load_model(tmp_path / "a.h5"))


@pytest.mark.parametrize("with_trim_file", [True, False])
def test_the_original_with_another_expression_basis(
    full_size: FullSize, tmp_path: Path, shared_dir: Path, with_trim_file: bool
) -> None:
    head, expression = untrimmed(full_size, 5), full_size.head.expression[:7]
    write_original_bfm(tmp_path, replace(head, mean=head.mean))
    write_guo(tmp_path, full_size.expression_mean, expression)
    if with_trim_file:
        content = (shared_dir / "models" / "bfm_mean" / "model_info.mat").read_bytes()
        (tmp_path / "model_info.mat").write_bytes(content)
    stored = import_model(tmp_path).model
    assert stored.published_basis == GUO_BASIS
    np.testing.assert_allclose(stored.mean, full_size.head.mean + full_size.expression_mean, atol=1e-3)
    np.testing.assert_allclose(stored.identity_basis, full_size.head.identity[:5], atol=1e-3)
    np.testing.assert_allclose(stored.expression_basis, expression, atol=1e-3)
    np.testing.assert_array_equal(stored.landmarks[IBUG68], full_size.keypoints)
    found = stored.polygons[np.lexsort(stored.polygons.T[:3])][:, :3]
    triangles = full_size.head.triangles
    np.testing.assert_array_equal(found, triangles[np.lexsort(triangles.T)])
    assert stored.albedo_mean is not None
    assert stored.albedo_mean.shape == (N_TRIMMED, 3)
    write_stored_model(stored, tmp_path / "a.h5")
    with pytest.raises(ModelMismatchError, match=f"{PUBLISHED_BASIS}.*7 expression components.*{GUO_BASIS}"):
        standard_deviations_of_300wlp(load_model(tmp_path / "a.h5"))


def test_the_list_of_left_out_vertices_is_the_authors(full_size: FullSize) -> None:
    expected = np.setdiff1d(np.arange(N_ORIGINAL), full_size.trim)
    np.testing.assert_array_equal(inner_mouth_vertices(), expected)
    assert len(expected) == 275


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("Exp_Pca.bin", b"\x07\0\0\0" + bytes(100), "a count of 7 in 104 bytes"),
        ("Exp_Pca.bin", b"\xff\xff\xff\xff" + bytes(100), "a count of -1"),
        ("Exp_Pca.bin", b"", "a count of 0 in 0 bytes"),
    ],
)
def test_broken_expression_files_are_refused(
    full_size: FullSize, tmp_path: Path, name: str, content: bytes, message: str
) -> None:
    write_original_bfm(tmp_path, untrimmed(full_size, 1))
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputFileError, match=message):
        read_model(tmp_path)
