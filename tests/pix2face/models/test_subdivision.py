"""Catmull-Clark: against what is known of it, and that it keeps what a model carries in step."""

import numpy as np
import pytest
from numpy import ndarray

from pix2face.models.model_file import StoredModel
from pix2face.models.subdivision import catmull_clark, refine, refined_symmetry
from tests.model_files import stored_small_head

CUBE_VERTICES = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
CUBE = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]], dtype=np.int32)
GRID_SIDE = 5


def grid() -> tuple[ndarray, ndarray]:
    """A flat, open grid of quads."""
    row, column = np.indices((GRID_SIDE, GRID_SIDE)).reshape(2, -1)
    vertices = np.stack([column, row, 0 * row], axis=1).astype(float)
    index = np.arange(GRID_SIDE**2, dtype=np.int32).reshape(GRID_SIDE, GRID_SIDE)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    return vertices, quads


def test_a_cube_becomes_what_the_paper_says() -> None:
    step = catmull_clark(CUBE, 8)
    points = step.operator @ CUBE_VERTICES
    np.testing.assert_allclose(np.abs(points[:8]), 5 / 9)  # (F + 2R) / 3 with F = 1/3, R = 2/3 of a corner
    np.testing.assert_allclose(np.sort(np.abs(points[8:20]), axis=1), [[0, 0.75, 0.75]] * 12)
    np.testing.assert_allclose(np.sort(np.abs(points[20:]), axis=1), [[0, 0, 1]] * 6)
    assert step.quads.shape == (24, 4)


def test_winding_and_parents_are_kept() -> None:
    step = catmull_clark(CUBE, 8)
    points = step.operator @ CUBE_VERTICES
    corners = points[step.quads]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    old = CUBE_VERTICES[CUBE]
    old_normals = np.cross(old[:, 1] - old[:, 0], old[:, 2] - old[:, 0])
    assert (np.einsum("qc,qc->q", normals, old_normals[step.parents]) > 0).all()
    assert np.bincount(step.parents).tolist() == [4] * 6


@pytest.mark.parametrize("polygons", [CUBE, grid()[1], np.array([[0, 1, 2, -1], [2, 1, 3, -1]], dtype=np.int32)])
def test_rows_sum_to_one(polygons: ndarray) -> None:
    operator = catmull_clark(polygons, int(polygons.max()) + 1).operator
    np.testing.assert_allclose(operator.sum(axis=1), 1)
    assert operator.min() >= 0


def test_a_flat_regular_grid_stays_put_inside_and_on_straight_borders() -> None:
    vertices, quads = grid()
    points = catmull_clark(quads, len(vertices)).operator @ vertices
    moved = np.linalg.norm(points[: len(vertices)] - vertices, axis=1)
    is_corner = (np.isin(vertices[:, :2], [0, GRID_SIDE - 1])).all(axis=1)
    np.testing.assert_allclose(moved[~is_corner], 0, atol=1e-12)
    assert (points[:, 2] == 0).all()
    assert points.min() >= 0  # the border is a crease: nothing leaves the square


def test_unused_vertices_stay() -> None:
    vertices = np.vstack([CUBE_VERTICES, [[9.0, 9, 9]]])
    np.testing.assert_array_equal((catmull_clark(CUBE, 9).operator @ vertices)[8], [9, 9, 9])


def test_refined_symmetry_mirrors_the_refined_mesh() -> None:
    mirror = np.array(
        [np.flatnonzero((v * [-1, 1, 1] == CUBE_VERTICES).all(axis=1))[0] for v in CUBE_VERTICES], np.int32
    )
    step = catmull_clark(CUBE, 8)
    symmetry = refined_symmetry(step, CUBE, mirror)
    points = step.operator @ CUBE_VERTICES
    np.testing.assert_allclose(points[symmetry], points * [-1, 1, 1], atol=1e-12)
    np.testing.assert_array_equal(symmetry[symmetry], np.arange(len(symmetry)))


def test_everything_a_model_carries_is_refined_alike() -> None:
    stored: StoredModel = stored_small_head()
    refined = refine(stored)
    assert (refined.polygons >= 0).all()
    assert len(refined.polygon_regions) == len(refined.polygons) == 3 * len(stored.polygons)
    rng = np.random.default_rng(0)
    weights = rng.normal(size=len(stored.identity_basis)).astype(np.float32)
    # Refining is linear: a face of the refined model is the refined face.
    face = stored.mean + np.tensordot(weights, stored.identity_basis, axes=1)
    operator = catmull_clark(stored.polygons, len(stored.mean)).operator
    expected = operator @ face.astype(np.float64)
    np.testing.assert_allclose(
        refined.mean + np.tensordot(weights, refined.identity_basis, axes=1), expected, atol=1e-3
    )
    assert refined.symmetry is not None
    np.testing.assert_allclose(refined.mean[refined.symmetry], refined.mean * [-1, 1, 1], atol=1e-3)
