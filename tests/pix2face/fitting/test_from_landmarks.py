import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.fitting.from_landmarks import LandmarkModel, fit_landmarks, fit_mean_to_landmarks
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from tests.synthetic_models import small_head_model

MODEL = LandmarkModel.of(small_head_model())


def known_face(pose, seed, scale=1.1):
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=len(MODEL.basis)).clip(-2, 2)
    camera = weak_perspective_camera(WeakPerspective(scale, rotation_of_pose(pose), np.array([200.0, 170.0])))
    landmarks3d = MODEL.landmarks3d(coefficients)
    return coefficients, camera, landmarks3d


def rms(fit):
    return np.sqrt(np.mean(np.concatenate([fit.identity, fit.expression]) ** 2))


@settings(max_examples=40)
@given(st.floats(-60, 60), st.floats(-90, 90), st.floats(-180, 180), st.integers(0, 10_000))
def test_every_pose_is_fitted(pitch, yaw, roll, seed):
    _, camera, landmarks3d = known_face(HeadPose(pitch, yaw, roll), seed)
    landmarks2d = camera.project(landmarks3d)
    fit = fit_landmarks(MODEL, landmarks2d, regularisation=0.05)
    mean_fit = fit_mean_to_landmarks(MODEL, landmarks2d).project(MODEL.mean)
    mean_error = np.linalg.norm(mean_fit - landmarks2d, axis=1).mean()
    error = np.linalg.norm(fit.landmarks2d - landmarks2d, axis=1).mean()
    assert error < 0.25 * mean_error
    assert rms(fit) < 2


@settings(max_examples=20)
@given(st.floats(-90, 90), st.floats(0.001, 100))
def test_scale_of_the_picture_does_not_matter(yaw, factor):
    _, camera, landmarks3d = known_face(HeadPose(5, yaw, 10), 3)
    landmarks2d = camera.project(landmarks3d)
    fit, scaled = fit_landmarks(MODEL, landmarks2d), fit_landmarks(MODEL, landmarks2d * factor)
    np.testing.assert_allclose(scaled.landmarks2d, fit.landmarks2d * factor, rtol=1e-3, atol=0.05 * factor)
    np.testing.assert_allclose(scaled.identity, fit.identity, atol=0.05)


def test_exact_coefficients_with_depth():
    coefficients, camera, landmarks3d = known_face(HeadPose(10, 40, -15), 7)
    depths = camera.depth(landmarks3d) * 1.1 + 33
    fit = fit_landmarks(MODEL, camera.project(landmarks3d), depths_px=depths, regularisation=1e-5)
    np.testing.assert_allclose(np.concatenate([fit.identity, fit.expression]), coefficients, atol=0.1)
    np.testing.assert_allclose(fit.camera.project(landmarks3d), camera.project(landmarks3d), atol=0.2)


def test_depth_improves_depth():
    errors = {False: [], True: []}
    for seed in range(10):
        _, camera, landmarks3d = known_face(HeadPose(0, 15, 0), seed)
        for with_depth in errors:
            depths = camera.depth(landmarks3d) * 1.1 if with_depth else None
            fit = fit_landmarks(MODEL, camera.project(landmarks3d), depths_px=depths)
            found = MODEL.landmarks3d(np.concatenate([fit.identity, fit.expression]))
            difference = fit.camera.depth(found) - camera.depth(landmarks3d)
            errors[with_depth].append(np.std(difference))
    assert np.mean(errors[True]) < 0.5 * np.mean(errors[False])


def test_left_out_landmarks_have_no_influence():
    _, camera, landmarks3d = known_face(HeadPose(0, 20, 0), 4)
    landmarks2d = camera.project(landmarks3d)
    weights = np.where(np.arange(68) % 5 == 0, 0.0, 1.0)
    spoiled = np.where(weights[:, None] == 0, np.nan, landmarks2d)
    fit, other = fit_landmarks(MODEL, landmarks2d, weights=weights), fit_landmarks(MODEL, spoiled)
    np.testing.assert_array_equal(fit.landmarks2d, other.landmarks2d)
    left_out = np.linalg.norm(fit.landmarks2d - landmarks2d, axis=1)[weights == 0].mean()
    mean_fit = fit_mean_to_landmarks(MODEL, landmarks2d, weights=weights).project(MODEL.mean)
    assert left_out < 0.7 * np.linalg.norm(mean_fit - landmarks2d, axis=1)[weights == 0].mean()


def test_regularisation_shrinks():
    _, camera, landmarks3d = known_face(HeadPose(0, 20, 0), 5)
    sizes = [rms(fit_landmarks(MODEL, camera.project(landmarks3d), regularisation=r)) for r in (0.01, 4.0, 1e5)]
    assert sizes[0] > sizes[1] > sizes[2]
    assert sizes[2] < 0.05


def test_bad_input_is_refused():
    _, camera, landmarks3d = known_face(HeadPose(0, 0, 0), 8)
    landmarks2d = camera.project(landmarks3d)
    with pytest.raises(DegenerateGeometryError, match="at least 6 landmarks, found 0"):
        fit_landmarks(MODEL, landmarks2d * np.nan)
    with pytest.raises(DegenerateGeometryError, match="found 5"):
        fit_landmarks(MODEL, landmarks2d, weights=np.where(np.arange(68) < 5, 1.0, 0.0))
    with pytest.raises(DegenerateGeometryError, match="one place"):
        fit_landmarks(MODEL, landmarks2d * 0)
    with pytest.raises(DegenerateGeometryError, match="positive regularisation"):
        fit_landmarks(MODEL, landmarks2d, regularisation=0.0)
    with pytest.raises(UsageError, match="menpo84"):
        LandmarkModel.of(small_head_model(), "menpo84")


def spoiled_landmarks(landmarks2d, seed, n=12):
    """Some landmarks moved by 10 to 30 % of the face, as a wrong or guessed annotation would be."""
    rng = np.random.default_rng(seed)
    wrong, angles = rng.choice(68, n, replace=False), rng.uniform(0, 2 * np.pi, n)
    size = np.sqrt(np.prod(np.ptp(landmarks2d, axis=0)))
    spoiled = landmarks2d.copy()
    spoiled[wrong] += (size * rng.uniform(0.1, 0.3, n) * np.stack([np.cos(angles), np.sin(angles)])).T
    return spoiled, wrong


def test_robust_fits_do_not_follow_wrong_landmarks():
    errors = {False: [], True: []}
    for seed in range(15):
        _, camera, landmarks3d = known_face(HeadPose(5, 4 * seed - 30, 3), seed)
        landmarks2d = camera.project(landmarks3d)
        spoiled, wrong = spoiled_landmarks(landmarks2d, seed)
        for robust in errors:
            fit = fit_landmarks(MODEL, spoiled, robust=robust)
            errors[robust].append(np.linalg.norm(fit.landmarks2d - landmarks2d, axis=1).mean())
        right = np.setdiff1d(np.arange(68), wrong)
        assert fit.trust[wrong].mean() < 0.3 < 0.6 < fit.trust[right].mean()
    assert np.mean(errors[True]) < 0.6 * np.mean(errors[False])


def test_robust_fits_of_clean_landmarks_are_nearly_the_plain_ones():
    for seed in range(5):
        _, camera, landmarks3d = known_face(HeadPose(0, 25, 0), seed)
        landmarks2d = camera.project(landmarks3d)
        plain, robust = fit_landmarks(MODEL, landmarks2d), fit_landmarks(MODEL, landmarks2d, robust=True)
        assert (plain.trust == 1).all()
        assert (robust.trust > 0.2).all()
        difference = np.linalg.norm(plain.landmarks2d - robust.landmarks2d, axis=1).mean()
        assert difference < 0.01 * np.sqrt(np.prod(np.ptp(landmarks2d, axis=0)))


def test_without_a_contour_landmarks_are_matched_with_themselves():
    _, camera, landmarks3d = known_face(HeadPose(0, 25, 0), 1)
    for robust in (False, True):
        fit = fit_landmarks(MODEL, camera.project(landmarks3d), robust=robust)
        np.testing.assert_array_equal(fit.matched2d, fit.landmarks2d)
