import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pix2face.fitting.least_squares.similarity import Similarity, rotated, rotation_jacobian


def random_similarity(seed, d):
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=seed).as_matrix()
    return Similarity(float(rng.normal()), rotation, rng.normal(size=d) * 50), rng.normal(size=(5, 3)) * 60


@given(st.integers(0, 10_000), st.sampled_from([2, 3]))
def test_jacobian_is_the_derivative(seed, d):
    similarity, points = random_similarity(seed, d)
    step = 1e-6
    numeric = np.stack(
        [
            (similarity.moved(step * e).apply(points) - similarity.moved(-step * e).apply(points)) / (2 * step)
            for e in np.eye(4 + d)
        ],
        axis=2,
    )
    np.testing.assert_allclose(similarity.jacobian(points), numeric, atol=1e-5 * similarity.scale * 100)


@given(st.integers(0, 10_000))
def test_camera_projects_as_the_similarity_does(seed):
    similarity, points = random_similarity(seed, 2)
    origin = np.array([3.0, -20.0, 60.0])
    np.testing.assert_allclose(similarity.camera(origin).project(points), similarity.apply(points - origin), atol=1e-9)


def test_rotation_jacobian_is_a_cross_product():
    rng = np.random.default_rng(1)
    points, increment = rng.normal(size=(4, 3)), rng.normal(size=3)
    np.testing.assert_allclose(rotation_jacobian(points) @ increment, np.cross(increment, points))


def test_rotated_stays_a_rotation():
    rotation = np.eye(3)
    for _ in range(100):
        rotation = rotated(rotation, np.array([0.3, -0.2, 0.1]))
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
