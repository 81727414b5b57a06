"""Rigid alignment with and without known partners."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.rigid_alignment import RigidTransform, align_surfaces, fit_rigid, surface_of, trimmed_rms
from pix2face.models.morphable_model import builtin_model
from tests.synthetic_models import small_head_model


@given(seed=st.integers(0, 10**6), n=st.integers(4, 30), scale=st.floats(0.2, 5))
def test_finds_the_motion_and_the_scale_it_does_not_apply(seed: int, n: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 50, (n, 3))
    true = RigidTransform(Rotation.random(rng=rng).as_matrix(), rng.normal(0, 100, 3))
    target = true.apply(points)
    centre = target.mean(axis=0)
    found, found_scale = fit_rigid(points, centre + scale * (target - centre))
    np.testing.assert_allclose(found.rotation, true.rotation, atol=1e-6)
    np.testing.assert_allclose(found.translation, true.translation, atol=1e-4)
    assert found_scale == pytest.approx(scale, rel=1e-6)


def test_a_mirror_image_is_never_a_rotation() -> None:
    points = np.random.default_rng(0).normal(size=(20, 3))
    found, _ = fit_rigid(points, points * [-1, 1, 1])
    assert np.linalg.det(found.rotation) == pytest.approx(1)


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.zeros((5, 3)), np.outer(np.arange(5.0), [1, 2, 3])])
def test_points_that_decide_nothing_are_refused(points: np.ndarray) -> None:
    with pytest.raises(DegenerateGeometryError):
        fit_rigid(points, points)


def test_matrix_does_what_apply_does() -> None:
    transform = RigidTransform(Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix(), np.array([1.0, 2, 3]))
    points = np.random.default_rng(0).normal(size=(5, 3))
    homogeneous = np.column_stack([points, np.ones(5)]) @ transform.matrix.T
    np.testing.assert_allclose(homogeneous[:, :3], transform.apply(points))


def test_a_face_finds_its_place_on_a_head_from_any_axes() -> None:
    head, rng = builtin_model(), np.random.default_rng(3)
    whole = surface_of(head.mean, triangles_as_polygons(head.triangles))
    axes = np.array([[0, 0, -1], [1, 0, 0], [0, -1, 0]])
    true = RigidTransform(Rotation.from_rotvec(rng.normal(0, 0.1, 3)).as_matrix() @ axes, rng.normal(0, 200, 3))
    part = whole.chosen(np.flatnonzero(head.is_face_vertex))
    found, distances = align_surfaces(part, whole.moved(true), np.array([[0.0, 20, 15]]))
    assert trimmed_rms(distances) < 0.2
    np.testing.assert_allclose(found.apply(part.points), true.apply(part.points), atol=0.5)


def triangles_as_polygons(triangles: np.ndarray) -> np.ndarray:
    return np.column_stack([triangles, np.full(len(triangles), -1)]).astype(np.int32)


def test_normals_face_outward_whatever_the_winding() -> None:
    head = small_head_model()
    polygons = triangles_as_polygons(head.triangles)
    there = surface_of(head.mean, polygons).normals
    np.testing.assert_allclose(surface_of(head.mean, polygons[:, [0, 2, 1, 3]]).normals, there, atol=1e-9)
    assert ((there * head.mean).sum(axis=1) > 0).mean() > 0.95
