"""Each alignment takes away what it may and nothing else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.landmark_metrics import aligned, distances3d

TRUTH = np.random.default_rng(0).normal(0, 50, (68, 3))


@given(st.integers(0, 1000), st.floats(0.1, 10))
def test_similarity_undoes_every_similarity_and_rigid_all_but_scale(seed, scale):
    random = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=random).as_matrix()
    moved = scale * TRUTH @ rotation.T + random.normal(0, 100, 3)
    assert distances3d(moved, TRUTH, "similarity").max() < 1e-6
    centred = np.linalg.norm(TRUTH - TRUTH.mean(axis=0), axis=1)
    np.testing.assert_allclose(distances3d(moved, TRUTH, "rigid"), abs(scale - 1) * centred, atol=1e-6)


def test_none_leaves_points_where_they_are():
    np.testing.assert_array_equal(aligned(TRUTH + 3, TRUTH, "none"), TRUTH + 3)
    assert distances3d(TRUTH + [3, 0, 4], TRUTH, "none") == pytest.approx(5)


def test_depth_moves_z_alone_and_mirrors_nothing():
    assert distances3d(TRUTH + [0, 0, 70], TRUTH, "depth").max() < 1e-9
    np.testing.assert_allclose(distances3d(TRUTH + [3, 4, 70], TRUTH, "depth"), 5)
    from_mean = TRUTH[:, 2] - TRUTH[:, 2].mean()
    np.testing.assert_allclose(distances3d(TRUTH * [1, 1, -1], TRUTH, "depth"), 2 * np.abs(from_mean))


def test_similarity_is_the_best_of_all_scales():
    noisy = TRUTH + np.random.default_rng(1).normal(0, 5, TRUTH.shape)
    best = (distances3d(noisy, TRUTH, "similarity") ** 2).sum()
    for scale in (0.97, 0.99, 1.0, 1.01, 1.03):
        assert (distances3d(scale * noisy, TRUTH, "rigid") ** 2).sum() >= best - 1e-6


def test_points_that_cannot_be_aligned_are_refused():
    with pytest.raises(DegenerateGeometryError, match="NaN"):
        aligned(np.full((68, 3), np.nan), TRUTH, "rigid")
    with pytest.raises(DegenerateGeometryError, match="line"):
        aligned(np.ones((68, 3)), TRUTH, "similarity")
