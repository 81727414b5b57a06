from collections import Counter
from itertools import chain, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from training.data.draw_order import DrawOrder, draws_of_batches
from training.data.shard_index import SampleSet


def sets_of(*weights_and_sizes: tuple[float, int]) -> list[SampleSet]:
    first, found = 0, []
    for weight, size in weights_and_sizes:
        found.append(SampleSet(weight, np.arange(first, first + size)))
        first += size
    return found


def test_one_set_is_passed_over_in_new_orders():
    order = DrawOrder(sets_of((1.0, 50)), seed=3)
    passes = [[order.sample_of(draw) for draw in range(50 * turn, 50 * turn + 50)] for turn in range(3)]
    assert all(sorted(one) == list(range(50)) for one in passes)
    assert len(set(map(tuple, passes))) == 3


def test_a_draw_is_the_same_in_whatever_order_draws_are_asked_for():
    sets = sets_of((0.7, 13), (0.2, 5), (0.1, 30))
    order = DrawOrder(sets, seed=1)
    forwards = [order.sample_of(draw) for draw in range(300)]
    backwards = [DrawOrder(sets, seed=1).sample_of(draw) for draw in reversed(range(300))]
    assert forwards == backwards[::-1]


@given(
    st.lists(st.tuples(st.floats(0.01, 100), st.integers(1, 20)), min_size=1, max_size=4),
    st.integers(0, 400),
)
def test_of_the_first_draws_each_set_has_its_share_and_within_it_every_sample_too(found, n):
    sets = sets_of(*found)
    order = DrawOrder(sets, seed=0)
    counts = Counter(order.sample_of(draw) for draw in range(n))
    total = sum(weight for weight, _ in found)
    for place, part in enumerate(sets):
        own = [counts[int(sample)] for sample in part.samples]
        assert abs(sum(own) - n * part.weight / total) <= 0.5 * (place + 2)
        assert max(own) - min(own) <= 1


def test_weights_do_not_pair_samples_with_places_in_a_batch():
    """Sets alternate: of ten draws in a row a set of weight 0.3 has three."""
    order = DrawOrder(sets_of((0.7, 100), (0.3, 100)), seed=0)
    of_second = [order.sample_of(draw) >= 100 for draw in range(1000)]
    assert {sum(of_second[k : k + 10]) for k in range(0, 1000, 10)} == {3}


def test_batches_are_consecutive_draws():
    assert list(draws_of_batches(8, 0, 4)) == []
    draws = list(draws_of_batches(8, 3, 4))
    assert draws == [[8, 9, 10, 11], [12, 13, 14, 15], [16, 17, 18, 19]]
    assert all(b[0] == a[-1] + 1 for a, b in pairwise(draws))


@pytest.mark.parametrize("n_ranks", [1, 2, 4])
def test_machines_divide_each_batch(n_ranks):
    whole, parts = draws_of_batches(16, 5, 8), [draws_of_batches(16, 5, 8, rank, n_ranks) for rank in range(n_ranks)]
    for batch, *own in zip(whole, *parts, strict=True):
        assert list(chain.from_iterable(own)) == batch
