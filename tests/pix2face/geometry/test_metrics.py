"""Metrics against computations written out by hand, and what must hold for any errors."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.landmark_metrics import (
    area_under_curve,
    error_curve,
    failure_rate,
    landmark_errors,
    nme,
    normalising_distance,
    summarise,
)
from pix2face.geometry.landmarks import INNER51

NORMALISERS = ("outer-eye", "inter-pupil", "box-sqrt", "box-diagonal")
ERRORS = st.lists(st.one_of(st.floats(0, 0.5), st.just(math.inf)), min_size=1, max_size=30)


def some_landmarks(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, 200, (68, 2))


def length_by_hand(truth: np.ndarray, normaliser: str) -> float:
    xs, ys = truth[:, 0].tolist(), truth[:, 1].tolist()
    width, height = max(xs) - min(xs), max(ys) - min(ys)
    if normaliser == "outer-eye":  # points 37 and 46, counted from 1
        return math.dist(truth[37 - 1], truth[46 - 1])
    if normaliser == "inter-pupil":
        right = (sum(xs[36:42]) / 6, sum(ys[36:42]) / 6)
        left = (sum(xs[42:48]) / 6, sum(ys[42:48]) / 6)
        return math.dist(right, left)
    return math.sqrt(width * height) if normaliser == "box-sqrt" else math.sqrt(width**2 + height**2)


@pytest.mark.parametrize("normaliser", NORMALISERS)
def test_nme_is_the_mean_distance_over_the_normaliser(normaliser):
    truth, predicted = some_landmarks(1), some_landmarks(2)
    distances = [math.dist(a, b) for a, b in zip(predicted, truth, strict=True)]
    length = length_by_hand(truth, normaliser)
    assert normalising_distance(truth, normaliser) == pytest.approx(length)
    assert nme(predicted, truth, normaliser) == pytest.approx(sum(distances) / 68 / length)
    assert nme(predicted, truth, normaliser, INNER51) == pytest.approx(sum(distances[17:]) / 51 / length)


@pytest.mark.parametrize("normaliser", NORMALISERS)
@given(scale=st.floats(0.1, 10), shift=st.floats(-1000, 1000))
def test_nme_does_not_depend_on_the_size_of_the_picture(normaliser, scale, shift):
    truth, predicted = some_landmarks(1), some_landmarks(2)
    moved = nme(scale * predicted + shift, scale * truth + shift, normaliser)
    assert moved == pytest.approx(nme(predicted, truth, normaliser), rel=1e-6)


def test_a_fit_that_is_not_finite_has_the_error_infinity():
    truth = some_landmarks()
    predicted = truth.copy()
    predicted[3] = np.nan
    assert nme(predicted, truth, "box-sqrt") == math.inf
    assert nme(predicted, truth, "box-sqrt", INNER51) == 0  # point 3 is on the jaw


def test_errors_of_landmarks_average_to_that_of_the_face():
    truth, predicted = some_landmarks(1), some_landmarks(2)
    errors = landmark_errors(predicted, truth, "box-diagonal")
    assert errors.mean() == pytest.approx(nme(predicted, truth, "box-diagonal"))
    assert errors[5] == pytest.approx(math.dist(predicted[5], truth[5]) / length_by_hand(truth, "box-diagonal"))
    assert landmark_errors(np.full((68, 2), np.nan), truth, "box-sqrt").min() == math.inf


@pytest.mark.parametrize("normaliser", NORMALISERS)
def test_truth_without_extent_is_refused(normaliser):
    with pytest.raises(DegenerateGeometryError, match=normaliser):
        nme(some_landmarks(), np.ones((68, 2)), normaliser)


@given(ERRORS)
def test_area_is_that_under_the_curve(errors):
    values = np.array(errors)
    curve = error_curve(values, 0.1, n=20001)
    area = np.trapezoid(curve[:, 1], curve[:, 0]) / 0.1
    assert area_under_curve(values, 0.1) == pytest.approx(area, abs=1e-3)


@given(ERRORS)
def test_curve_ends_where_the_failures_begin(errors):
    values = np.array(errors)
    curve = error_curve(values, 0.1)
    assert curve[-1, 1] == pytest.approx(1 - failure_rate(values, 0.1))
    assert (np.diff(curve[:, 1]) >= 0).all()
    assert failure_rate(values, 0.1) == sum(error > 0.1 for error in errors) / len(errors)


def test_failed_fits_stay_in_counts_and_rates_and_leave_means():
    summary = summarise(np.array([0.02, 0.04, math.inf, math.inf]), 0.08)
    assert (summary.n_images, summary.n_failed) == (4, 2)
    assert summary.mean == summary.median == pytest.approx(0.03)
    assert summary.failure_rate == 0.5
    assert summary.area_under_curve == pytest.approx((0.75 + 0.5) / 4)


def test_no_faces_have_no_figures():
    summary = summarise(np.array([]), 0.08)
    assert (summary.n_images, summary.mean, summary.area_under_curve, summary.failure_rate) == (0, None, None, None)
    assert summarise(np.array([math.inf]), 0.08).mean is None
