import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.cameras.camera_fit import fit_affine_camera, fit_weak_perspective_camera
from pix2face.fitting.least_squares.robust import huber_weights
from pix2face.geometry.camera import (
    HeadPose,
    WeakPerspective,
    affine_camera,
    head_pose,
    nearest_weak_perspective,
    rotation_of_pose,
    weak_perspective_camera,
)
from tests.cameras import posed_camera

angles = st.floats(-89, 89)


def face_like_points(n=60, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 3)) * [60, 80, 40] + [0, -10, 60]


def weak_camera(pitch, yaw, roll, scale=1.3):
    return posed_camera(128, 140, pitch_deg=pitch, yaw_deg=yaw, roll_deg=roll, scale=scale)


@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6), st.floats(-500, 500))
def test_affine_fit_is_exact(entries, shift):
    linear = np.diag([3.0, -3.0, 0.0])[:2] + np.reshape(entries, (2, 3))
    a = np.column_stack([linear, [shift, -shift]])
    points = face_like_points()
    camera = fit_affine_camera(points, points @ a[:, :3].T + a[:, 3])
    np.testing.assert_allclose(camera.matrix[:2], affine_camera(a).matrix[:2], atol=1e-8)


def test_affine_fit_agrees_with_lstsq_on_noise():
    points = face_like_points()
    image = weak_camera(10, 30, 5).project(points) + np.random.default_rng(1).normal(size=(60, 2))
    expected = np.linalg.lstsq(np.column_stack([points, np.ones(60)]), image, rcond=None)[0].T
    np.testing.assert_allclose(fit_affine_camera(points, image).matrix[:2], expected, atol=1e-9)


@given(angles, st.floats(-180, 180), st.floats(-180, 180), st.floats(0.01, 50))
def test_weak_perspective_fit_is_exact_for_any_pose(pitch, yaw, roll, scale):
    points = face_like_points()
    true = weak_camera(pitch, yaw, roll, scale)
    fitted = fit_weak_perspective_camera(points, true.project(points))
    np.testing.assert_allclose(fitted.matrix, true.matrix, atol=1e-5 * max(scale, 1))


def test_weak_perspective_fit_is_a_minimum():
    points = face_like_points()
    rng = np.random.default_rng(2)
    image = weak_camera(10, 60, -20).project(points) + 3 * rng.normal(size=(60, 2))
    best = nearest_weak_perspective(fit_weak_perspective_camera(points, image))

    def error(parameters):
        return ((weak_perspective_camera(parameters).project(points) - image) ** 2).sum()

    for _ in range(50):
        turn = rotation_of_pose(HeadPose(*rng.normal(size=3) * 0.2)) @ rotation_of_pose(HeadPose(0, 0, 0)).T
        other = WeakPerspective(
            best.scale * (1 + 0.003 * rng.normal()),
            turn @ best.rotation,
            best.translation_px + 0.1 * rng.normal(size=2),
        )
        assert error(other) > error(best)


@pytest.mark.parametrize("yaw", [-75, -20, 0, 40, 80])
def test_flat_points_are_enough_for_weak_perspective(yaw):
    points = face_like_points() * [1, 1, 0]
    true = weak_camera(12, yaw, 15)
    image = true.project(points)
    fitted = fit_weak_perspective_camera(points, image)
    # Orthography leaves the tilt of a plane ambiguous in sign: the picture is the same.
    np.testing.assert_allclose(fitted.project(points), image, atol=1e-4)


def test_huber_ignores_outliers():
    points = face_like_points(300)
    rng = np.random.default_rng(3)
    true = weak_camera(5, 50, 10)
    image = true.project(points) + 0.3 * rng.normal(size=(300, 2))
    image[:45] += rng.normal(size=(45, 2)) * 60
    pose = head_pose(true)

    def yaw_error(robust):
        return abs(head_pose(fit_weak_perspective_camera(points, image, robust=robust)).yaw_deg - pose.yaw_deg)

    assert yaw_error(True) < 0.5
    assert yaw_error(True) < yaw_error(False)


def test_huber_weights():
    np.testing.assert_allclose(huber_weights(np.array([0.0, 1, 2, 8]), 2.0), [1, 1, 1, 0.25])


def test_weight_zero_leaves_a_point_out():
    points = face_like_points()
    true = weak_camera(0, 20, 0)
    image = true.project(points)
    image[7] = np.nan
    fitted = fit_weak_perspective_camera(points, image, weights=np.where(np.arange(60) == 7, 0.0, 1.0))
    np.testing.assert_allclose(fitted.matrix, true.matrix, atol=1e-6)


@pytest.mark.parametrize("fit", [fit_affine_camera, fit_weak_perspective_camera])
def test_degenerate_points_are_refused(fit):
    points = face_like_points()
    image = weak_camera(0, 0, 0).project(points)
    with pytest.raises(DegenerateGeometryError, match="at least 4 points, found 3"):
        fit(points[:3], image[:3])
    with pytest.raises(DegenerateGeometryError, match="finite"):
        fit(points, np.where(np.arange(60)[:, None] == 3, np.nan, image))
    with pytest.raises(DegenerateGeometryError, match=r"one line|one plane"):
        fit(points * [1, 0, 0], image)


def test_affine_refuses_a_plane_and_weak_perspective_one_place():
    points = face_like_points()
    with pytest.raises(DegenerateGeometryError, match="one plane"):
        fit_affine_camera(points * [1, 1, 0], points[:, :2])
    with pytest.raises(DegenerateGeometryError, match="one place"):
        fit_weak_perspective_camera(points, np.full((60, 2), 7.0))
