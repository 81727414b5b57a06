import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.cameras.camera_fit import fit_affine_camera
from pix2face.fitting.cameras.pinhole_fit import FARTHEST_MM, PinholeState, fit_pinhole_camera, linearised_pinhole
from pix2face.geometry.camera import HeadPose, Pinhole, pinhole_camera, pinhole_of, rotation_of_pose

CENTRE = np.array([128.0, 128.0])


def face_like_points(n=200, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, size=(n, 3)) * [70, 90, 50] + [0, -10, 60]


def near_pinhole(yaw=20.0, pitch=5.0, roll=-10.0, distance=600.0, principal_point=CENTRE, aside=(0.0, 0.0)):
    rotation = rotation_of_pose(HeadPose(pitch, yaw, roll))
    translation = np.array([*aside, distance]) - rotation @ [0, -10, 60]
    return pinhole_camera(Pinhole(distance * 1.1, np.asarray(principal_point, dtype=float), rotation, translation))


def refit(points, image, principal_point=CENTRE):
    return fit_pinhole_camera(points, image, np.asarray(principal_point, dtype=float), fit_affine_camera(points, image))


@settings(max_examples=40)
@given(st.floats(-89, 89), st.floats(-60, 60), st.floats(-180, 180), st.floats(250, 5000))
def test_recovers_the_camera(yaw, pitch, roll, distance):
    points = face_like_points()
    true = near_pinhole(yaw, pitch, roll, distance)
    fitted = refit(points, true.project(points))
    np.testing.assert_allclose(fitted.project(points), true.project(points), atol=1e-5)
    assert pinhole_of(fitted).focal_px == pytest.approx(pinhole_of(true).focal_px, rel=1e-4)


def test_recovers_a_face_far_off_the_optical_axis():
    points = face_like_points()
    true = near_pinhole(principal_point=[400, -150], aside=(-250, 200), distance=500)
    fitted = refit(points, true.project(points), [400, -150])
    np.testing.assert_allclose(fitted.matrix, true.matrix, rtol=1e-6, atol=1e-3)


def test_agrees_with_scipy_on_noise():
    points = face_like_points()
    image = near_pinhole().project(points) + 0.5 * np.random.default_rng(1).normal(size=(200, 2))
    fitted = pinhole_of(refit(points, image))

    def residuals(p):
        rotation = Rotation.from_rotvec(p[1:4]).as_matrix()
        camera = pinhole_camera(Pinhole(float(np.exp(p[0])), CENTRE, rotation, p[4:7]))
        return (camera.project(points) - image).ravel()

    rotvec = Rotation.from_matrix(fitted.rotation).as_rotvec()
    start = np.concatenate([[np.log(fitted.focal_px * 1.3)], rotvec, fitted.translation_mm * [1, 1, 1.3]])
    oracle = least_squares(residuals, start, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    assert fitted.focal_px == pytest.approx(np.exp(oracle[0]), rel=1e-4)
    np.testing.assert_allclose(fitted.translation_mm, oracle[4:7], atol=0.2)


def test_an_image_without_perspective_gets_a_far_camera():
    points = face_like_points()
    affine = np.column_stack([1.2 * rotation_of_pose(HeadPose(0, 30, 0))[:2], [120.0, 130.0]])
    image = points @ affine[:, :3].T + affine[:, 3]
    reverse_of_perspective = CENTRE + (image - CENTRE) * (1 - 2e-4 * (points[:, 2:] - 60))
    for bent in (image, reverse_of_perspective):
        fitted = refit(points, bent)
        depth = fitted.depth(points)
        assert depth.min() > 0.5 * FARTHEST_MM
        assert np.isfinite(fitted.matrix).all()
    np.testing.assert_allclose(refit(points, image).project(points), image, atol=0.02)


def test_degenerate_points_are_refused():
    points = face_like_points()
    true = near_pinhole()
    image = true.project(points)
    affine = fit_affine_camera(points, image)
    with pytest.raises(DegenerateGeometryError, match="at least 6 points, found 5"):
        fit_pinhole_camera(points[:5], image[:5], CENTRE, affine)
    with pytest.raises(DegenerateGeometryError, match="finite"):
        fit_pinhole_camera(points, image * np.where(np.arange(200)[:, None] == 9, np.inf, 1), CENTRE, affine)
    flat = points * [1, 1, 0]
    with pytest.raises(DegenerateGeometryError, match="plane or line"):
        fit_pinhole_camera(flat, true.project(flat), CENTRE, affine)


@pytest.mark.parametrize("inverse_distance", [0.0, 1 / 400, -1 / 900])
def test_the_jacobian_is_the_derivative(inverse_distance):
    """Against central differences."""
    points = face_like_points() - face_like_points().mean(axis=0)
    state = PinholeState(0.1, rotation_of_pose(HeadPose(12, -40, 25)), np.array([30.0, -50.0]), inverse_distance)
    jacobian = linearised_pinhole(state, points, np.zeros((len(points), 2)))[1]
    for index, size in enumerate([1e-5] * 4 + [1e-3] * 2 + [1e-8]):
        step = size * np.eye(7)[index]
        difference = (state.moved(step).apply(points) - state.moved(-step).apply(points)) / (2 * size)
        np.testing.assert_allclose(jacobian[:, :, index], difference, rtol=1e-5, atol=1e-5 * np.abs(difference).max())


def test_gross_errors_do_not_move_a_robust_fit():
    points, rng = face_like_points(), np.random.default_rng(5)
    true = near_pinhole()
    image = true.project(points) + 0.05 * rng.standard_normal((len(points), 2))
    wrong = rng.uniform(size=len(points)) < 0.1
    image[wrong] += rng.normal(0, 40, (int(wrong.sum()), 2))
    initial = fit_affine_camera(points, image, robust=True)
    errors = [
        abs(
            pinhole_of(fit_pinhole_camera(points, image, CENTRE, initial, robust=robust)).focal_px
            / pinhole_of(true).focal_px
            - 1
        )
        for robust in (True, False)
    ]
    assert errors[0] < 0.01 < errors[1]
