from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from training.schedule import learning_rate


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
