"""Pairs of triangles: each triangle once, with its winding; numberings that keep neighbours together."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy import ndarray

from datagen.rendering.triangle_pairs import local_order, pair_triangles
from pix2face.models.morphable_model import builtin_model
from tests.meshes import sheet
from tests.synthetic_models import small_head_model


def same_triangle(a: ndarray, b: ndarray) -> ndarray:
    """Whether corners are the same up to turning."""
    return np.any([(np.roll(a, k, axis=1) == b).all(axis=1) for k in range(3)], axis=0)


def check(triangles: ndarray) -> int:
    """Whether the pairs are the mesh; returns how many there are."""
    pairs = pair_triangles(triangles)
    assert len(pairs.triangles) == 2 * len(pairs.corners)
    first, second = pairs.source[0::2], pairs.source[1::2]
    is_lone = first == second
    assert sorted([*first, *second[~is_lone]]) == list(range(len(triangles)))
    assert same_triangle(pairs.triangles[0::2], triangles[first]).all()
    assert same_triangle(pairs.triangles[1::2][~is_lone], triangles[second][~is_lone]).all()
    assert (pairs.corners[is_lone, 2] == pairs.corners[is_lone, 3]).all()
    real = np.ones(len(pairs.source), dtype=bool)
    real[1::2] = ~is_lone
    np.testing.assert_array_equal(pairs.at_corners(triangles)[real], pairs.triangles[real])
    return len(pairs.corners)


def test_a_head_is_paired_almost_whole() -> None:
    for triangles in (builtin_model().triangles, small_head_model().triangles):
        assert check(triangles) < 0.6 * len(triangles)


@settings(max_examples=60)
@given(st.lists(st.tuples(*[st.integers(0, 7)] * 3), max_size=20))
def test_any_triangles_are_each_there_once(corners: list[tuple[int, int, int]]) -> None:
    """Also several at an edge, twice the same, wound against each other, with corners that coincide."""
    check(np.array(corners, dtype=np.int32).reshape(-1, 3))


@pytest.mark.parametrize("seed", range(3))
def test_shuffled_triangles_find_their_partners(seed: int) -> None:
    triangles = np.random.default_rng(seed).permutation(sheet(30, 30)[1])
    assert check(triangles) < 0.62 * len(triangles)


def test_shuffled_vertices_are_put_in_order_and_ordered_ones_stay() -> None:
    points, triangles = sheet(60, 60)
    np.testing.assert_array_equal(local_order(points.astype(np.float32), triangles), np.arange(len(points)))
    shuffled = np.random.default_rng(0).permutation(len(points))
    place = np.argsort(shuffled).astype(np.int32)
    order = local_order(points[shuffled].astype(np.float32), place[triangles])
    assert sorted(order) == list(range(len(points)))
    new_place = np.argsort(order)
    steps = np.abs(new_place[place[triangles][:, 0]] - new_place[place[triangles][:, 1]])
    assert np.median(steps) < 20
