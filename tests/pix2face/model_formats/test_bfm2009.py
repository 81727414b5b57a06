"""BFM 2009 as 300W-LP uses it: files of ours in its layout."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.model_formats.bfm2009 import read_bfm2009, standard_deviations_of_300wlp
from pix2face.models.model_file import write_stored_model
from pix2face.models.morphable_model import load_model
from tests.synthetic_models import small_head_model

N_IDENTITY, N_EXPRESSION = 199, 29


def write_bfm(folder: Path, expression_file: str = "Model_Expression.mat", **changes: object) -> dict[str, ndarray]:
    """Writes the small head in BFM's layout: µm, 1-based, wound inward, a mean expression that is not zero."""
    head, rng = small_head_model(), np.random.default_rng(0)
    n = 3 * len(head.mean)
    mean_um = 1000 * head.mean.astype(np.float64).reshape(n, 1)
    expression_mean = rng.normal(0, 900, (n, 1))
    fields: dict[str, ndarray] = {
        "mu_shape": mean_um - expression_mean,
        "w": rng.normal(0, 1e-3, (n, N_IDENTITY)),
        "sigma": rng.uniform(1e5, 1e6, (N_IDENTITY, 1)),
        "tri": head.triangles[:, [0, 2, 1]].T + 1.0,
        "keypoints": head.landmarks["ibug68"][None] + 1.0,
        "mu_exp": expression_mean,
        "w_exp": rng.normal(0, 300, (n, N_EXPRESSION)),
        "sigma_exp": rng.uniform(0.1, 2, (N_EXPRESSION, 1)),
    }
    fields.update(changes)  # type: ignore[arg-type]
    fields = {name: value for name, value in fields.items() if value is not None}
    names = ("mu_exp", "w_exp", "sigma_exp")
    scipy.io.savemat(folder / "Model_Shape.mat", {k: v for k, v in fields.items() if k not in names})
    scipy.io.savemat(folder / expression_file, {k: v for k, v in fields.items() if k in names})
    return fields


@pytest.mark.parametrize("expression_file", ["Model_Expression.mat", "Model_Exp.mat"])
def test_geometry_is_the_published_formula_in_mm(tmp_path: Path, expression_file: str) -> None:
    fields = write_bfm(tmp_path, expression_file)
    write_stored_model(read_bfm2009(tmp_path), tmp_path / "model.h5")
    model = load_model(tmp_path / "model.h5")
    rng = np.random.default_rng(1)
    shape, expression = rng.normal(0, 3e5, N_IDENTITY), rng.normal(0, 1, N_EXPRESSION)
    posed = fields["mu_shape"][:, 0] + fields["mu_exp"][:, 0] + fields["w"] @ shape + fields["w_exp"] @ expression
    units = standard_deviations_of_300wlp(model)
    assert units is not None
    found = model.vertices((shape / units[0])[None], (expression / units[1])[None])[0]
    np.testing.assert_allclose(found, posed.reshape(-1, 3) / 1000, atol=2e-3)


def test_triangles_are_turned_outward_and_indices_count_from_zero(tmp_path: Path) -> None:
    write_bfm(tmp_path)
    stored, head = read_bfm2009(tmp_path / "Model_Shape.mat"), small_head_model()
    assert set(map(tuple, np.sort(stored.polygons[:, :3], axis=1))) == set(map(tuple, np.sort(head.triangles, axis=1)))
    corners = stored.mean[stored.polygons[:, :3]].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("tc,tc->t", normals, corners.mean(axis=1)) > 0).mean() > 0.9
    np.testing.assert_array_equal(stored.landmarks["ibug68"], head.landmarks["ibug68"])


def test_another_model_is_not_taken_for_bfm() -> None:
    assert standard_deviations_of_300wlp(small_head_model()) is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"w": None}, "missing are w"),
        ({"sigma": np.ones((5, 1))}, "one for each standard deviation"),
        ({"mu_exp": np.full((6993, 1), np.nan)}, "3 finite coordinates"),
        ({"tri": np.full((3, 4), 1e6)}, "expected vertices 1 to"),
        ({"keypoints": np.zeros((1, 68))}, "expected vertices 1 to"),
    ],
)
def test_bad_files_are_one_clear_line(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    write_bfm(tmp_path, **changes)
    with pytest.raises(InputFileError, match=message):
        read_bfm2009(tmp_path)


def test_missing_and_truncated_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=r"expected Model_Shape\.mat and Model_Expression\.mat or Model_Exp\.mat"):
        read_bfm2009(tmp_path)
    write_bfm(tmp_path)
    path = tmp_path / "Model_Shape.mat"
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(InputFileError, match=r"Model_Shape\.mat: expected a MAT 5 file"):
        read_bfm2009(tmp_path)
