"""The model in memory and its file."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.models.model_file import read_stored_model, write_stored_model
from pix2face.models.morphable_model import load_model, triangulate
from tests.model_files import stored_small_head, write_small_head
from tests.synthetic_models import small_head_model


def test_zero_coefficients_are_the_mean() -> None:
    model = small_head_model()
    vertices = model.vertices(np.zeros((2, model.n_identity)), np.zeros((2, model.n_expression)))
    np.testing.assert_array_equal(vertices, np.stack([model.mean, model.mean]))


def test_a_batch_equals_single_faces_and_the_obvious_sum() -> None:
    model, rng = small_head_model(), np.random.default_rng(0)
    identity, expression = rng.normal(size=(3, model.n_identity)), rng.normal(size=(3, model.n_expression))
    batch = model.vertices(identity, expression)
    for one, alpha, beta in zip(batch, identity, expression, strict=True):
        obvious = model.mean.astype(np.float64)
        for coefficient, component in zip(alpha, model.identity_basis, strict=True):
            obvious = obvious + coefficient * component
        for coefficient, component in zip(beta, model.expression_basis, strict=True):
            obvious = obvious + coefficient * component
        np.testing.assert_allclose(one, obvious, atol=1e-3)
        np.testing.assert_allclose(one, model.vertices(alpha[None], beta[None])[0], atol=1e-4)


def test_a_model_survives_its_file(tmp_path: Path) -> None:
    model, loaded = small_head_model(), load_model(write_small_head(tmp_path / "model.h5"))
    for name in ("mean", "identity_basis", "expression_basis", "triangles", "triangle_regions", "symmetry"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(model, name))
    for name in ("name", "licence", "origin", "region_names", "face_regions"):
        assert getattr(loaded, name) == getattr(model, name)
    np.testing.assert_array_equal(loaded.landmarks["ibug68"], model.landmarks["ibug68"])
    assert set(loaded.named_expressions) == set(model.named_expressions)


def test_quantised_bases_are_off_by_at_most_half_a_step(tmp_path: Path) -> None:
    stored = stored_small_head()
    write_stored_model(stored, tmp_path / "model.h5", quantise=True)
    read, _ = read_stored_model(tmp_path / "model.h5")
    step = np.abs(stored.identity_basis).max(axis=(1, 2), keepdims=True) / 32767
    assert (np.abs(read.identity_basis - stored.identity_basis) <= 0.51 * step).all()


def test_the_hash_is_that_of_the_content(tmp_path: Path) -> None:
    first = load_model(write_small_head(tmp_path / "a.h5")).sha256
    assert load_model(write_small_head(tmp_path / "b.h5")).sha256 == first
    with h5py.File(tmp_path / "b.h5", "r+") as file:
        file["mean"][0, 0] += 1e-3
    assert load_model(tmp_path / "b.h5").sha256 != first


@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.7, 0.99])
def test_truncated_files_are_one_clear_line(tmp_path: Path, fraction: float) -> None:
    path = write_small_head(tmp_path / "model.h5")
    content = path.read_bytes()
    path.write_bytes(content[: int(fraction * len(content))])
    with pytest.raises(InputFileError, match=r"model\.h5: expected") as caught:
        load_model(path)
    assert "\n" not in str(caught.value)


def test_missing_foreign_and_newer_files_say_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such model file"):
        load_model(tmp_path / "nothing.h5")
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file.attrs["format"] = np.bytes_("something else")
    with pytest.raises(InputFileError, match="datagen model import"):
        load_model(tmp_path / "foreign.h5")
    path = write_small_head(tmp_path / "model.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["schema_version"] = 2
    with pytest.raises(InputFileError, match="newer than 1"):
        load_model(path)


def test_triangulation_keeps_winding_and_order() -> None:
    polygons = np.array([[0, 1, 2, 3], [4, 5, 6, -1], [7, 8, 9, 10]], dtype=np.int32)
    triangles, parents = triangulate(polygons)
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [7, 8, 9], [7, 9, 10]]
    assert parents.tolist() == [0, 0, 1, 2, 2]
