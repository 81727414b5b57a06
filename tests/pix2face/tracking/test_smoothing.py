"""Smoothers: what they leave as it is, what they take away, how long they wait; and jitter."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.errors import UsageError
from pix2face.tracking.smoothing import SMOOTHINGS, SPLINE_PENALTY, JitterMeter, open_smoother

FPS = 25.0
UNIT = 100.0


def smoothed(kind: str, points: np.ndarray, fps: float = FPS) -> np.ndarray:
    smoother = open_smoother(kind, fps)
    done = [own for frame in points for own in smoother.push(frame, UNIT)]
    return np.stack(done + smoother.flush()) if len(points) else points


def jitter(points: np.ndarray) -> float:
    meter = JitterMeter()
    for frame in points:
        meter.push(frame, UNIT)
    return meter.share


@pytest.mark.parametrize("kind", SMOOTHINGS)
@given(n_frames=st.integers(0, 40))
def test_every_frame_comes_back_once_and_in_order(kind, n_frames):
    points = np.zeros((n_frames, 3, 2)) + np.arange(n_frames)[:, None, None] * 1e-9
    result = smoothed(kind, points)
    assert result.shape == points.shape
    np.testing.assert_allclose(result, points, atol=1e-6)


@pytest.mark.parametrize("kind", SMOOTHINGS)
def test_no_frame_waits_for_more_than_the_delay(kind):
    smoother = open_smoother(kind, FPS)
    n_done = 0
    for index in range(60):
        n_done += len(smoother.push(np.zeros((2, 2)), UNIT))
        assert n_done == max(0, index + 1 - smoother.delay)
    assert len(smoother.flush()) == smoother.delay


@pytest.mark.parametrize("kind", ["none", "mean3", "spline"])
@given(seed=st.integers(0, 100), n_frames=st.integers(1, 40))
def test_steady_motion_passes_unchanged(kind, seed, n_frames):
    start, speed = np.random.default_rng(seed).normal(size=(2, 5, 2))
    points = start + np.arange(n_frames)[:, None, None] * speed
    np.testing.assert_allclose(smoothed(kind, points), points, atol=1e-9)


@pytest.mark.parametrize(("kind", "most"), [("mean3", 0.5), ("one-euro", 0.5), ("spline", 0.2)])
def test_noise_on_a_still_face_shrinks(kind, most):
    noisy = 50 + np.random.default_rng(0).normal(0, 0.5, (300, 20, 2))
    assert jitter(smoothed(kind, noisy)) < most * jitter(noisy)
    assert np.abs(smoothed(kind, noisy) - 50).mean() < np.abs(noisy - 50).mean()


def test_mean3_is_the_mean_of_three_and_leaves_the_ends():
    points = np.random.default_rng(0).normal(size=(10, 4, 2))
    result = smoothed("mean3", points)
    np.testing.assert_allclose(result[1:-1], (points[:-2] + points[1:-1] + points[2:]) / 3)
    np.testing.assert_array_equal(result[[0, -1]], points[[0, -1]])


def test_the_spline_of_a_short_clip_is_that_of_the_whole_clip():
    points = np.random.default_rng(0).normal(size=(13, 4, 2))
    differences = np.diff(np.eye(13), 2, axis=0)
    whole = np.linalg.solve(np.eye(13) + SPLINE_PENALTY * differences.T @ differences, points.reshape(13, -1))
    np.testing.assert_allclose(smoothed("spline", points), whole.reshape(points.shape), atol=1e-12)


def test_the_window_of_the_spline_costs_little_in_a_long_clip():
    points = np.random.default_rng(0).normal(size=(80, 4, 2))
    differences = np.diff(np.eye(80), 2, axis=0)
    whole = np.linalg.solve(np.eye(80) + SPLINE_PENALTY * differences.T @ differences, points.reshape(80, -1))
    assert np.abs(smoothed("spline", points) - whole.reshape(points.shape)).max() < 5e-3


def test_one_euro_follows_fast_motion_more_closely_than_a_fixed_low_pass_would():
    points = np.repeat((np.arange(60) * 10.0)[:, None, None], 2, axis=2)  # 2.5 eye distances a second
    lag_px = (points - smoothed("one-euro", points))[-1].max()
    assert 0 < lag_px < 10.0 * 1.0  # less than a frame; a low-pass of 2 Hz would be 2 frames behind


def test_a_flushed_smoother_begins_anew():
    for kind in SMOOTHINGS:
        smoother = open_smoother(kind, FPS)
        points = np.random.default_rng(0).normal(size=(20, 3, 2))
        first = [own for frame in points for own in smoother.push(frame, UNIT)] + smoother.flush()
        again = [own for frame in points for own in smoother.push(frame, UNIT)] + smoother.flush()
        np.testing.assert_array_equal(first, again)


def test_jitter_is_the_mean_second_difference_over_the_eye_distance():
    points = np.random.default_rng(0).normal(size=(9, 5, 2))
    expected = np.linalg.norm(points[:-2] - 2 * points[1:-1] + points[2:], axis=2).mean() / UNIT
    assert jitter(points) == pytest.approx(expected)
    assert jitter(points[:2]) is None
    assert jitter(np.arange(5.0)[:, None, None] * np.ones((5, 3, 2))) == pytest.approx(0)


def test_no_jitter_is_measured_across_a_cut():
    meter = JitterMeter()
    for frame in (0.0, 1.0, 2.0, None, 90.0, 91.0, 92.0):
        if frame is None:
            meter.cut()
        else:
            meter.push(np.full((3, 2), frame), UNIT)
    assert meter.share == pytest.approx(0)


def test_an_unknown_smoothing_is_refused():
    with pytest.raises(UsageError, match="none, mean3, one-euro, spline, found 'median'"):
        open_smoother("median", FPS)
