from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from training.recipe.schedule import learning_rate, smooth_rate


def test_the_papers_ends():
    assert learning_rate(0, 60, 1e-3) == 1e-3
    assert learning_rate(59, 60, 1e-3) == pytest.approx(2.1e-5)


@given(st.integers(2, 200), st.floats(1e-6, 1))
def test_each_epoch_falls_by_the_same_factor(epochs, initial):
    rates = [learning_rate(epoch, epochs, initial) for epoch in range(epochs)]
    factors = [after / before for before, after in pairwise(rates)]
    assert factors == pytest.approx([0.021 ** (1 / (epochs - 1))] * (epochs - 1))


def test_a_single_epoch_keeps_the_initial_rate():
    assert learning_rate(0, 1, 0.5) == 0.5


@pytest.mark.parametrize("schedule", ["linear", "cosine"])
@given(st.integers(1, 300), st.integers(0, 400))
def test_smooth_schedules_rise_then_fall_and_never_reach_0(schedule, steps, warm_up_steps):
    rates = [smooth_rate(schedule, step, steps, warm_up_steps) for step in range(steps)]
    top = min(warm_up_steps, steps)
    assert all(before < after for before, after in pairwise(rates[: top + 1]))
    assert all(before > after for before, after in pairwise(rates[top:]))
    assert all(0 < rate <= 1 for rate in rates)


def test_their_curves():
    assert smooth_rate("linear", 75, 100, 50) == pytest.approx(0.5)
    assert smooth_rate("cosine", 75, 100, 50) == pytest.approx(0.5)
    assert smooth_rate("cosine", 99, 100, 0) == pytest.approx(2.467e-4, rel=1e-3)
    assert smooth_rate("linear", 50, 100, 50) == 1
    assert smooth_rate("linear", 49, 100, 50) == 50 / 51
