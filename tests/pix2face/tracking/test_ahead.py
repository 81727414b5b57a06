"""Items that a thread makes ahead: the same, in their order, a bounded number of them, and no thread that stays."""

import threading
import time
from collections.abc import Iterator

import pytest

from pix2face.tracking.ahead import ahead, mapped


@pytest.mark.parametrize("count", [1, 3])
def test_items_come_in_their_order_and_only_so_many_are_made_before(count):
    made = []

    def items() -> Iterator[int]:
        for index in range(20):
            made.append(index)
            yield index

    n_threads = threading.active_count()
    for index, own in enumerate(ahead(items(), count)):
        assert own == index
        assert len(made) <= index + 1 + count
    assert made == list(range(20))
    assert threading.active_count() == n_threads


def test_the_next_item_is_made_while_one_is_looked_at():
    asked = threading.Event()

    def items() -> Iterator[int]:
        yield 0
        asked.set()
        yield 1

    made = ahead(items(), 1)
    assert next(made) == 0
    assert asked.wait(10)


def test_an_exception_comes_behind_the_items_before_it():
    def items() -> Iterator[int]:
        yield 0
        raise ValueError("damaged")

    made = ahead(items(), 3)
    assert next(made) == 0
    with pytest.raises(ValueError, match="damaged"):
        next(made)


def test_who_stops_early_leaves_no_thread():
    n_threads = threading.active_count()
    made = ahead(iter(range(1000)), 2)
    next(made)
    made.close()
    assert threading.active_count() == n_threads


def test_results_come_in_the_order_of_their_items() -> None:
    def slow(item: int) -> int:
        time.sleep(0.003 * (item % 3))
        return item * item

    assert list(mapped(slow, range(30))) == [item * item for item in range(30)]


def test_two_items_are_computed_at_a_time() -> None:
    both = threading.Barrier(2, timeout=10)
    assert len(list(mapped(lambda _: both.wait(), range(8)))) == 8


def test_an_exception_of_a_function_comes_in_its_turn() -> None:
    results = mapped(lambda item: 6 // (3 - item), range(9))
    assert [next(results) for _ in range(3)] == [2, 3, 6]
    with pytest.raises(ZeroDivisionError):
        next(results)
