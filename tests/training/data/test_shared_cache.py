import pickle
from multiprocessing import get_context

import pytest

from training.data.shared_cache import SharedCache


def test_what_was_put_comes_back_and_stays():
    cache = SharedCache(4, 1000)
    assert cache.get(2) is None
    cache.put(2, b"two")
    cache.put(0, b"nought")
    cache.put(2, b"another")
    assert bytes(cache.get(2)) == b"two"
    assert bytes(cache.get(0)) == b"nought"
    assert cache.get(1) is None


def test_the_budget_is_kept():
    cache = SharedCache(10, 300)
    for place in range(10):
        cache.put(place, bytes([place]) * 90)
    kept = [place for place in range(10) if cache.get(place) is not None]
    assert kept == [0, 1]  # pieces begin at multiples of 64: a third one would end beyond 300
    cache.put(5, b"a small one")
    assert bytes(cache.get(5)) == b"a small one"


def _put(cache: SharedCache, first: int) -> None:
    for place in range(first, 100, 2):
        cache.put(place, place.to_bytes(2, "big") * 50)


def test_processes_share_it():
    cache = SharedCache(100, 100 * 128)
    workers = [get_context("spawn").Process(target=_put, args=(cache, first)) for first in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
        assert worker.exitcode == 0
    assert [bytes(cache.get(place)) for place in range(100)] == [place.to_bytes(2, "big") * 50 for place in range(100)]
    cache.put(0, b"late")
    assert bytes(cache.get(0)) == b"\0\0" * 50


def test_it_travels_with_a_new_process_alone():
    with pytest.raises(RuntimeError):
        pickle.dumps(SharedCache(1, 10))
