"""Figures of draws against the same figures computed draw by draw, and intervals against theory."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.evaluation.figures import bootstrap
from pix2face.evaluation.figures.bootstrap import (
    Bootstrap,
    cluster_indices,
    intervals,
    mean_of,
    mean_of_statistics,
    median_of,
)

ERRORS = st.lists(st.one_of(st.floats(0, 0.5), st.just(np.inf)), min_size=2, max_size=12)


@given(ERRORS, st.integers(0, 2**31))
def test_figures_of_a_draw_are_those_of_the_faces_drawn(errors, seed):
    values = np.array(errors)
    drawn = np.random.default_rng(seed).integers(0, len(values), len(values))
    draws = np.bincount(drawn, minlength=len(values))[None].astype(np.float64)
    finite = values[drawn][np.isfinite(values[drawn])]
    mean, median = mean_of(values)(draws)[0], median_of(values)(draws)[0]
    if len(finite):
        assert mean == pytest.approx(finite.mean())
        assert median == pytest.approx(np.median(finite))
    else:
        assert np.isnan(mean)
        assert np.isnan(median)
    failed = (values > 0.1).astype(np.float64)
    assert mean_of(failed)(draws)[0] == pytest.approx(failed[drawn].mean())


def test_the_mean_of_groups_lacks_draws_without_one_of_them():
    first, second = np.array([1.0, np.inf]), np.array([np.inf, 3.0])
    draws = np.array([[1.0, 1.0], [2.0, 0.0]])
    values = mean_of_statistics([mean_of(first), mean_of(second)])(draws)
    assert values[0] == 2
    assert np.isnan(values[1])


def test_the_interval_of_a_mean_is_that_of_the_central_limit():
    errors = np.random.default_rng(0).normal(0.05, 0.01, 400)
    low, high = intervals({"mean": mean_of(errors)}, np.arange(400), Bootstrap(4000, 1))["mean"]
    half_width = 1.96 * errors.std() / np.sqrt(400)
    assert low == pytest.approx(errors.mean() - half_width, abs=0.08 * half_width)
    assert high == pytest.approx(errors.mean() + half_width, abs=0.08 * half_width)


def test_frames_of_a_clip_are_drawn_together():
    """Forty like frames of each clip tell no more than one."""
    of_clips = np.random.default_rng(0).normal(0.05, 0.01, 10)
    of_frames = np.repeat(of_clips, 40)
    clips = cluster_indices([f"clip {index}" for index in range(10) for _ in range(40)])
    together = intervals({"mean": mean_of(of_frames)}, clips, Bootstrap(2000, 3))["mean"]
    once = intervals({"mean": mean_of(of_clips)}, np.arange(10), Bootstrap(2000, 3))["mean"]
    apart = intervals({"mean": mean_of(of_frames)}, np.arange(400), Bootstrap(2000, 3))["mean"]
    assert together == pytest.approx(once)
    assert np.ptp(apart) < 0.3 * np.ptp(together)


def test_the_same_seed_gives_the_same_interval_however_much_fits_into_memory(monkeypatch):
    errors = np.random.default_rng(0).uniform(0, 1, 50)
    whole, other = (
        intervals({"mean": mean_of(errors)}, np.arange(50), Bootstrap(200, seed))["mean"] for seed in (0, 1)
    )
    assert whole != other
    monkeypatch.setattr(bootstrap, "LARGEST_TABLE", 350)
    assert intervals({"mean": mean_of(errors)}, np.arange(50), Bootstrap(200, 0))["mean"] == pytest.approx(whole)


def test_where_nothing_can_be_drawn_there_is_no_interval():
    errors = np.array([0.1, 0.2])
    mean = {"mean": mean_of(errors)}
    assert intervals(mean, np.array([0, 0]), Bootstrap())["mean"] is None
    assert intervals(mean, np.array([0, 1]), Bootstrap(0))["mean"] is None
    assert intervals({"mean": mean_of(np.array([]))}, np.array([], dtype=np.intp), Bootstrap())["mean"] is None
    failed = {"mean": mean_of(np.full(2, np.inf))}
    assert intervals(failed, np.array([0, 1]), Bootstrap())["mean"] is None
