"""Every reader against files of ours in its layout: same vertices, whatever unit and order the layout has."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.geometry.landmarks import IBUG68
from pix2face.model_formats import read_model
from pix2face.models.model_file import StoredModel, write_stored_model
from pix2face.models.morphable_model import load_model
from tests.published_models import (
    Head,
    small_head,
    write_bfm,
    write_flame,
    write_gnm,
    write_ict,
    write_original_bfm,
    write_statismo,
    write_surrey,
)
from tests.synthetic_models import small_head_model

WRITERS = {
    "flame": lambda folder, head: write_flame(folder / "a.pkl", head),
    "flame without chumpy": lambda folder, head: write_flame(folder / "a.pkl", head, chumpy=False, protocol=4),
    "gnm": lambda folder, head: write_gnm(folder / "a.npz", head),
    "gnm compressed": lambda folder, head: write_gnm(folder / "a.npz", head, compressed=True),
    "surrey": write_surrey,
    "ict": write_ict,
    "statismo": lambda folder, head: write_statismo(folder / "a.h5", head),
    "statismo in metres": lambda folder, head: write_statismo(folder / "a.h5", head, unit_m=1.0),
    "bfm 2009": lambda folder, head: write_bfm(folder, head, small_head_model().landmarks[IBUG68]),
    "bfm 2009 compressed": lambda folder, head: write_bfm(
        folder, head, small_head_model().landmarks[IBUG68], compressed=True
    ),
}


def coefficients(head: Head, stored: StoredModel) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    """Random ones for the components that a head has, and for those that the layout pads with zeros."""
    rng = np.random.default_rng(5)
    identity, expression = rng.normal(size=len(head.identity)), rng.normal(size=len(head.expression))
    padded = np.zeros((1, len(stored.identity_basis))), np.zeros((1, len(stored.expression_basis)))
    padded[0][0, : len(identity)], padded[1][0, : len(expression)] = identity, expression
    return identity, expression, *padded


@pytest.mark.parametrize("layout", WRITERS)
def test_vertices_come_back_through_the_projects_file(tmp_path: Path, layout: str) -> None:
    head = small_head()
    stored = read_model(WRITERS[layout](tmp_path, head))
    write_stored_model(stored, tmp_path / "model.h5")
    if any((indices < 0).any() for indices in stored.landmarks.values()):
        stored = replace(stored, landmarks={})
        write_stored_model(stored, tmp_path / "model.h5")
    identity, expression, *padded = coefficients(head, stored)
    found = load_model(tmp_path / "model.h5").vertices(*padded)[0]
    np.testing.assert_allclose(found, head.vertices(identity, expression), atol=1e-3)


@pytest.mark.parametrize("layout", [name for name in WRITERS if not name.startswith(("ict", "bfm"))])
def test_triangles_come_back(tmp_path: Path, layout: str) -> None:
    head = small_head()
    np.testing.assert_array_equal(read_model(WRITERS[layout](tmp_path, head)).polygons[:, :3], head.triangles)


def test_mean_of_expressions_belongs_to_the_mean(tmp_path: Path) -> None:
    head, offset = small_head(), np.full((len(small_head().mean), 3), [0.0, -9.0, 4.0])
    path = write_statismo(tmp_path / "a.h5", head, expression_mean=offset)
    np.testing.assert_allclose(read_model(path).mean, head.mean, atol=1e-3)


def test_albedo_is_kept_in_0_to_1_at_one_standard_deviation(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("statismo", "surrey", "bfm")]
    for folder in folders:
        folder.mkdir()
    head = small_head()
    models = [
        read_model(write_statismo(folders[0] / "a.h5", head)),
        read_model(write_surrey(folders[1], head, colour=True)),
        read_model(write_original_bfm(folders[2], head)),
    ]
    for stored, mean, deviation in zip(models, (0.5, 0.5, 0.2), (0.1, 0.5, 0.02), strict=True):
        assert stored.albedo_mean is not None
        assert stored.albedo_basis is not None
        np.testing.assert_allclose(stored.albedo_mean, mean, atol=1e-6)
        np.testing.assert_allclose(stored.albedo_basis, deviation, atol=1e-5)
        write_stored_model(stored, tmp_path / "model.h5")
        loaded = load_model(tmp_path / "model.h5")
        assert loaded.albedo_basis is not None
        np.testing.assert_array_equal(loaded.albedo_basis, stored.albedo_basis)


def test_quads_stay_quads(tmp_path: Path) -> None:
    head = small_head()
    quads = np.array([[0, 1, 2, 3], [4, 5, 6, 6]], dtype=np.int32)
    stored = read_model(write_gnm(tmp_path / "a.npz", head, quads=quads))
    np.testing.assert_array_equal(stored.polygons, [[0, 1, 2, 3], [4, 5, 6, -1]])
    assert stored.refinement_steps == 0


def test_blendshapes_keep_their_names_and_count_one(tmp_path: Path) -> None:
    head = small_head()
    stored = read_model(write_surrey(tmp_path, head))
    assert list(stored.named_expressions) == ["shape 0", "shape 1", "shape 2"]
    np.testing.assert_array_equal(stored.named_expressions["shape 1"], [0, 1, 0])
    np.testing.assert_allclose(stored.expression_basis, head.expression, atol=1e-5)


def test_texture_of_surrey_is_turned_upward(tmp_path: Path) -> None:
    stored = read_model(write_surrey(tmp_path, small_head()))
    assert stored.uv is not None
    np.testing.assert_allclose(stored.uv[0], [0, 1 - 1 / (2 * len(stored.uv) - 1)], atol=1e-6)
    assert stored.uv_polygons is not None


def test_materials_become_regions_and_transparent_shells_go(tmp_path: Path) -> None:
    head = small_head()
    stored = read_model(write_ict(tmp_path, head))
    assert len(stored.polygons) == len(head.triangles) - 1
    assert len(stored.mean) == len(head.mean)
    names = [stored.region_names[i] for i in stored.polygon_regions]
    assert (names.count("skin"), names.count("scalp")) == (len(head.triangles) - 2, 1)
    assert "scalp" not in stored.face_regions


def test_named_landmarks_of_basel_become_numbers(tmp_path: Path) -> None:
    head = small_head()
    rows = [
        {"id": "center.nose.tip", "coordinates": head.mean[7].tolist()},
        {"id": "left.eye.corner_outer", "coordinates": head.mean[9].tolist()},
        {"id": "left.ear.tragus.tip", "coordinates": head.mean[11].tolist()},
    ]
    landmarks = read_model(write_statismo(tmp_path / "a.h5", head, landmarks=json.dumps(rows))).landmarks[IBUG68]
    assert (landmarks[30], landmarks[45], (landmarks >= 0).sum()) == (7, 9, 2)


@pytest.mark.parametrize("text", ["{", "[1]", '[{"id": "center.nose.tip"}]', '[{"id": 1, "coordinates": ["a"]}]'])
def test_foreign_landmarks_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputFileError, match="landmarks"):
        read_model(write_statismo(tmp_path / "a.h5", small_head(), landmarks=text))


@pytest.mark.parametrize(
    "change",
    [
        {"mean": np.full((2331, 3), np.nan)},
        {"identity": np.full((5, 2331, 3), np.inf)},
        {"triangles": np.full((4, 3), 2331)},
        {"triangles": np.full((4, 3), -1)},
    ],
    ids=["mean", "basis", "beyond", "negative"],
)
@pytest.mark.parametrize("layout", ["flame", "gnm", "surrey", "statismo", "bfm 2009"])
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_impossible_arrays_are_one_clear_error(tmp_path: Path, layout: str, change: dict[str, ndarray]) -> None:
    head = replace(small_head(), **change)  # type: ignore[arg-type]
    assert len(small_head().mean) == 2331
    with pytest.raises(InputFileError, match=r"expected"):
        read_model(WRITERS[layout](tmp_path, head))


def test_shapes_with_other_numbers_of_vertices_are_refused(tmp_path: Path) -> None:
    folder = write_ict(tmp_path, small_head()) / "FaceXModel"
    path = folder / "identity001.obj"
    path.write_text("\n".join(path.read_text().splitlines()[:400]))
    with pytest.raises(InputFileError, match=r"identity001\.obj: expected 2331 vertices .* found 399"):
        read_model(tmp_path)


@pytest.mark.parametrize(
    ("old", "new"),
    [("f ", "f 1 2 "), ("v ", "v x "), ("f ", "f 9999999 "), ("f ", "f 0 "), ("usemtl M_Face\n", "f a b c\n")],
)
def test_broken_lines_of_meshes_are_refused(tmp_path: Path, old: str, new: str) -> None:
    path = write_ict(tmp_path, small_head()) / "FaceXModel" / "generic_neutral_mesh.obj"
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputFileError, match=r"generic_neutral_mesh\.obj.*expected"):
        read_model(tmp_path)
