"""Import: unit, frame, landmarks; what is approximate is marked; size is never touched."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy import ndarray
from scipy.spatial.transform import Rotation

from pix2face.errors import InputFileError
from pix2face.geometry.landmarks import IBUG68
from pix2face.model_formats.model_import import ImportedModel, import_model
from pix2face.model_formats.tables import table_rows
from pix2face.models.model_file import read_stored_model, write_stored_model
from pix2face.models.morphable_model import builtin_model, load_model
from tests.published_models import Head, write_bfm, write_gnm, write_statismo

TURN = Rotation.from_euler("XYZ", [80, 10, -95], degrees=True).as_matrix()
SHIFT_MM = np.array([300.0, -200.0, 50.0])


def builtin_head(*, scale: float = 1.0, shape_seed: int | None = None) -> Head:
    """The built-in head, another person where there is a seed, in another frame, with a few components."""
    model = builtin_model()
    identity = np.zeros((1, model.n_identity))
    if shape_seed is not None:
        identity = np.random.default_rng(shape_seed).normal(size=identity.shape)
    mean = model.vertices(identity, np.zeros((1, model.n_expression)))[0].astype(np.float64)
    turned = scale * (mean @ TURN.T + SHIFT_MM)
    return Head(turned, model.identity_basis[:3] @ TURN.T, model.expression_basis[:2] @ TURN.T, model.triangles)


def basel_landmarks(head: Head, unit: float = 1.0) -> str:
    """Metadata with the twelve named points of the built-in head."""
    vertices = builtin_model().landmarks[IBUG68]
    rows = [(name, head.mean[vertices[int(number)]] / unit) for number, name in table_rows("basel_names")]
    return json.dumps([{"id": name, "coordinates": place.tolist()} for name, place in rows])


def landmark_errors_mm(imported: ImportedModel) -> ndarray:
    """How far imported landmarks of the built-in topology lie from the true ones."""
    stored = imported.model
    found, true = stored.landmarks[IBUG68], builtin_model().landmarks[IBUG68]
    return np.linalg.norm(stored.mean[found] - stored.mean[true], axis=1)


def test_named_landmarks_undo_frame_and_unit(tmp_path: Path) -> None:
    head = builtin_head()
    path = write_statismo(tmp_path / "a.h5", head, unit_m=1.0, landmarks=basel_landmarks(head, unit=1000))
    imported = import_model(path)
    model = builtin_model()
    np.testing.assert_allclose(imported.model.mean, model.mean, atol=1e-2)
    np.testing.assert_allclose(imported.model.identity_basis, model.identity_basis[:3], atol=1e-3)
    assert imported.model.alignment is not None
    assert imported.model.alignment.residual_mm < 0.01
    assert imported.model.alignment.landmark_scale == pytest.approx(1, abs=1e-4)
    assert landmark_errors_mm(imported).mean() < 1


def test_size_is_never_touched(tmp_path: Path) -> None:
    head = builtin_head(scale=1.08)
    imported = import_model(write_statismo(tmp_path / "a.h5", head, landmarks=basel_landmarks(head)))
    assert imported.model.alignment is not None
    assert imported.model.alignment.landmark_scale == pytest.approx(1 / 1.08, rel=1e-3)
    size = np.linalg.norm(np.ptp(builtin_model().mean, axis=0))
    assert np.linalg.norm(np.ptp(imported.model.mean, axis=0)) == pytest.approx(1.08 * size, rel=1e-4)
    assert "not applied" in imported.notes[0]


@pytest.mark.parametrize("scale", [0.1, 1000.0])
def test_a_wrong_unit_is_refused(tmp_path: Path, scale: float) -> None:
    head = builtin_head(scale=scale)
    with pytest.raises(InputFileError, match=r"12 landmarks within 12 mm .*the unit or the landmarks are wrong"):
        import_model(write_statismo(tmp_path / "a.h5", head, landmarks=basel_landmarks(head)))


def test_without_landmarks_they_come_by_correspondence_and_say_so(tmp_path: Path) -> None:
    head = builtin_head(shape_seed=1)
    inward = replace(head, triangles=np.asarray(head.triangles)[:, [0, 2, 1]])
    imported = import_model(write_gnm(tmp_path / "a.npz", inward))
    stored = imported.model
    errors = landmark_errors_mm(imported)
    assert errors.mean() < 3
    assert errors.max() < 9
    np.testing.assert_array_equal(stored.approximate_landmarks, np.arange(68))
    assert "approximate" in imported.notes[0]
    corners = stored.mean[stored.polygons[:, :3]].astype(np.float64)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.einsum("tc,tc->", outward, corners.mean(axis=1)) > 0
    # Regions come the same way: what is face there is face here.
    is_face = np.isin(stored.polygon_regions, [stored.region_names.index(name) for name in stored.face_regions])
    assert (is_face == builtin_model().is_face_triangle).mean() > 0.93
    write_stored_model(stored, tmp_path / "model.h5")
    loaded = load_model(tmp_path / "model.h5")
    np.testing.assert_array_equal(loaded.approximate_landmarks, np.arange(68))
    alignment = read_stored_model(tmp_path / "model.h5")[0].alignment
    assert alignment is not None
    assert alignment.residual_mm < 3
    undone = (head.mean @ alignment.frame_from_file[:3, :3].T) + alignment.frame_from_file[:3, 3]
    np.testing.assert_allclose(loaded.mean, undone, atol=1e-3)


def test_a_ball_is_no_face(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=30)
    none = np.zeros((1, *ball.vertices.shape))
    imported = import_model(
        write_gnm(tmp_path / "a.npz", Head(np.array(ball.vertices), none, none, np.array(ball.faces)))
    )
    assert imported.model.landmarks == {}
    assert imported.model.alignment is None
    np.testing.assert_allclose(imported.model.mean, ball.vertices, atol=1e-4)
    assert "no face was found" in imported.notes[0]


def test_bfm_2009_keeps_its_frame(tmp_path: Path) -> None:
    model = builtin_model()
    head = Head(model.mean.astype(np.float64), model.identity_basis[:3], model.expression_basis[:2], model.triangles)
    head = replace(head, mean=head.mean + [2, -3, 1])
    imported = import_model(write_bfm(tmp_path, head, model.landmarks[IBUG68]))
    np.testing.assert_allclose(imported.model.mean, head.mean, atol=1e-4)
    alignment = imported.model.alignment
    assert alignment is not None
    np.testing.assert_array_equal(alignment.frame_from_file, np.eye(4))
    assert alignment.residual_mm == pytest.approx(np.sqrt(14), abs=1e-3)
    assert "the frame is the project's as published" in imported.notes[0]
