"""The published models at hand, against independent readings of the same files and the figures that are known."""

import struct
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.geometry.landmarks import IBUG68
from pix2face.model_formats import read_model
from pix2face.model_formats.model_import import ImportedModel, import_model
from pix2face.models.model_file import read_stored_model, write_stored_model
from pix2face.models.morphable_model import load_model

TOLERANCE_MM = 1e-3


def check_through_import(path: Path, out: Path, mean: ndarray, identity: ndarray, expression: ndarray) -> ImportedModel:
    """Imports, writes, loads, evaluates; the same by the arrays of the independent reading and the stored transform."""
    imported = import_model(path)
    write_stored_model(imported.model, out)
    loaded, stored = load_model(out), read_stored_model(out)[0]
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(4, len(identity))), rng.normal(size=(4, len(expression)))
    expected = mean + np.tensordot(a, identity, axes=1) + np.tensordot(b, expression, axes=1)
    if stored.alignment is not None:
        frame = stored.alignment.frame_from_file
        np.testing.assert_allclose(frame[:3, :3] @ frame[:3, :3].T, np.eye(3), atol=1e-12)
        expected = expected @ frame[:3, :3].T + frame[:3, 3]
    np.testing.assert_allclose(loaded.vertices(a, b), expected, atol=TOLERANCE_MM)
    return imported


def read_surrey_independently(folder: Path) -> tuple[ndarray, ndarray, ndarray, ndarray, list[str]]:
    """Mean, columns, variances and blendshapes at the offsets that the sizes imply."""
    content = (folder / "sfm_shape_3448.bin").read_bytes()
    n, k = 10344, 63
    mean = np.frombuffer(content, "<f4", n, 12)
    basis = np.frombuffer(content, "<f4", n * k, 12 + 4 * n + 8).reshape(k, n)
    variances = np.frombuffer(content, "<f4", k, 12 + 4 * n + 8 + 4 * n * k + 8)
    shapes, names = [], []
    rest = (folder / "expression_blendshapes_3448.bin").read_bytes()
    at = 8
    for _ in range(struct.unpack_from("<Q", rest)[0]):
        length = struct.unpack_from("<Q", rest, at)[0]
        names.append(rest[at + 8 : at + 8 + length].decode())
        shapes.append(np.frombuffer(rest, "<f4", n, at + 16 + length))
        at += 16 + length + 4 * n
    return mean, basis, variances, np.stack(shapes), names


def test_surrey(shared_dir: Path, tmp_path: Path) -> None:
    folder = shared_dir / "models" / "surrey"
    mean, basis, variances, shapes, names = read_surrey_independently(folder)
    path = folder / "sfm_shape_3448.bin"
    stored = read_model(path)
    assert (len(stored.mean), len(stored.polygons)) == (3448, 6736)
    assert list(stored.named_expressions) == names == ["anger", "disgust", "fear", "happiness", "sadness", "surprise"]
    np.testing.assert_allclose((stored.identity_basis.astype(np.float64) ** 2).sum(axis=(1, 2)), variances, rtol=1e-4)
    np.testing.assert_allclose(variances[:3], [56502.367, 29755.393, 9637.453], rtol=1e-6)
    identity = basis.astype(np.float64) * np.sqrt(variances.astype(np.float64))[:, None]
    stored = check_through_import(
        path, tmp_path / "a.h5", mean.reshape(-1, 3), identity.reshape(-1, 3448, 3), shapes.reshape(-1, 3448, 3)
    ).model
    # It lacks most jaw points, and says so.
    assert stored.approximate_landmarks is not None
    np.testing.assert_array_equal(stored.approximate_landmarks, [*range(8), *range(9, 17), 60, 64])
    places = stored.mean[stored.landmarks[IBUG68]]
    # From the image's left to its right, and around the chin: what a misplaced point would break.
    assert (np.diff(places[:17, 0]) > 0).all()
    assert abs(places[60, 0] + places[64, 0]) < 3
    assert places[60, 0] < places[61, 0] < places[63, 0] < places[64, 0]


def read_obj_independently(path: Path) -> ndarray:
    return np.array([line.split()[1:4] for line in path.read_text().splitlines() if line.startswith("v ")], dtype=float)


def test_ict_facekit(shared_dir: Path, tmp_path: Path) -> None:
    folder = shared_dir / "models" / "ict_facekit"
    inside = folder / "FaceXModel"
    neutral = 10 * read_obj_independently(inside / "generic_neutral_mesh.obj")
    identity = np.stack([10 * read_obj_independently(inside / f"identity{i:03d}.obj") - neutral for i in range(6)])
    names = ("browInnerUp_L", "eyeBlink_L", "jawOpen", "mouthSmile_L")
    expression = np.stack([10 * read_obj_independently(inside / f"{name}.obj") - neutral for name in names])
    stored = read_model(folder)
    assert list(stored.named_expressions) == list(names)
    assert len(stored.mean) == 26719
    is_face = stored.polygon_regions == stored.region_names.index("skin")
    assert stored.polygons[is_face].max() == 9408
    assert (stored.polygons[:, 3] >= 0).mean() > 0.9
    np.testing.assert_allclose(stored.mean.min(axis=0), neutral.min(axis=0), atol=1e-4)
    imported = check_through_import(folder, tmp_path / "a.h5", neutral, identity, expression)
    # The landmarks are the published list.
    stored = imported.model
    assert stored.landmarks[IBUG68][[0, 8, 30, 67]].tolist() == [1225, 966, 4857, 5966]
    assert stored.approximate_landmarks is None
    assert stored.alignment is not None
    assert stored.alignment.residual_mm < 5
    assert 0.9 < stored.alignment.landmark_scale < 1.1
    assert "68 published landmarks" in imported.notes[0]
    assert "not applied" in imported.notes[0]


def import_statismo(shared_dir: Path, tmp_path: Path, name: str, sizes: tuple[int, int, int]) -> ImportedModel:
    path = shared_dir / "models" / "statismo" / f"{name}.h5"
    with h5py.File(path, "r") as file:

        def basis(part: str) -> ndarray:
            columns = file[f"{part}/model/pcaBasis"][:].astype(float) * np.sqrt(file[f"{part}/model/pcaVariance"][:])
            return columns.T.reshape(columns.shape[1], -1, 3)

        mean = file["shape/model/mean"][:].reshape(-1, 3).astype(float)
        identity, expression = basis("shape"), np.zeros((0, *mean.shape))
        if "expression" in file:
            mean = mean + file["expression/model/mean"][:].reshape(-1, 3)
            expression = basis("expression")
    assert (len(mean), len(identity), len(expression)) == sizes
    stored = read_model(path)
    assert stored.albedo_basis is not None
    return check_through_import(path, tmp_path / "a.h5", mean, identity, expression)


def test_what_is_no_face_is_imported_without_landmarks_and_says_so(shared_dir: Path, tmp_path: Path) -> None:
    imported = import_statismo(shared_dir, tmp_path, "random-momo", (25, 10, 10))
    assert imported.model.landmarks == {}
    assert imported.model.alignment is None
    assert "no face was found" in imported.notes[0]


def test_named_landmarks_align_and_the_rest_is_approximate(shared_dir: Path, tmp_path: Path) -> None:
    stored = import_statismo(shared_dir, tmp_path, "random-l4", (1529, 19, 0)).model
    assert stored.approximate_landmarks is not None
    assert len(stored.approximate_landmarks) == 56
    assert 30 not in stored.approximate_landmarks
    # It is a decimated Basel head, so the built-in model's frame, which is Basel's, turns it by little.
    assert stored.alignment is not None
    assert np.trace(stored.alignment.frame_from_file[:3, :3]) > 1 + 2 * np.cos(np.deg2rad(6))
    assert np.abs(stored.alignment.frame_from_file[:3, 3]).max() < 6


@pytest.mark.parametrize("name", ["foreign_mat", "300wlp", "300w", "video"])
def test_folders_of_other_things_are_refused(shared_dir: Path, name: str) -> None:
    for path in [shared_dir / "data" / name, *sorted((shared_dir / "data" / name).iterdir())]:
        with pytest.raises(InputFileError, match="BFM 2009"):
            read_model(path)
