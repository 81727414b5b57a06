"""Drawing one of several names."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from datagen.random_streams import weighted_choice


@given(st.lists(st.floats(0.01, 100), min_size=1, max_size=12), st.integers(0, 1000))
def test_a_weighted_choice_is_that_of_numpy(weights: list[float], seed: int) -> None:
    names = {f"name {place}": weight for place, weight in enumerate(weights)}
    ours, reference = np.random.default_rng(seed), np.random.default_rng(seed)
    shares = np.array(weights) / np.sum(weights)
    assert [weighted_choice(ours, names) for _ in range(5)] == list(reference.choice(list(names), 5, p=shares))
