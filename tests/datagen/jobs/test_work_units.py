"""Units are finished on a place whose workers die: again, behind the others, the last time alone."""

import os
import signal
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from typing import Any

import pytest

from datagen.jobs.executors import ProcessPool, WorkPlace
from datagen.jobs.work_units import ATTEMPTS, finish_units
from pix2face.errors import UsageError


class FakeExecutor(Executor):
    """Runs everything that was handed over when asked to, in the order of its coming."""

    def __init__(self, place: "FakePlace") -> None:
        self.place = place

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        unit = args[0]
        self.place.under_way.append((future, unit))
        self.place.together.append(len([1 for other, _ in self.place.under_way if not other.done()]))
        if len(self.place.under_way) == self.place.gather:
            self.place.run_all(fn)
        return future


class FakePlace(WorkPlace):
    """Whose pools break when a deadly unit runs. The first ones run several units together, all later ones one."""

    def __init__(self, deadly: dict[int, int], at_once: int, gather: tuple[int, ...] = ()) -> None:
        self.at_once, self.gathers, self.gather = at_once, gather, 1
        self.deadly, self.n_opened, self.together = Counter(deadly), 0, list[int]()
        self.under_way: list[tuple[Future[Any], int]] = []

    @contextmanager
    def open(self, on_report: object) -> Iterator[Executor]:
        self.n_opened += 1
        self.gather = dict(enumerate(self.gathers, 1)).get(self.n_opened, 1)
        self.under_way = []
        yield FakeExecutor(self)

    def run_all(self, fn: Any) -> None:
        futures, self.under_way = self.under_way, []
        for future, unit in futures:
            if self.deadly[unit] > 0:
                self.deadly[unit] -= 1
                for other, _ in futures:
                    if not other.done():
                        other.set_exception(BrokenExecutor("a worker died"))
                return
            try:
                future.set_result(fn(unit))
            except ArithmeticError as error:
                future.set_exception(error)


def finish(units: list[int], place: FakePlace) -> list[int]:
    finished: list[int] = []

    def on_finished(unit: int, result: int) -> None:
        assert result == unit * unit
        finished.append(unit)

    finish_units(units, place, lambda executor, unit: executor.submit(lambda n: n * n, unit), on_finished)
    return finished


def test_every_unit_is_finished_once() -> None:
    place = FakePlace({}, at_once=2)
    assert sorted(finish(list(range(9)), place)) == list(range(9))
    assert place.n_opened == 1
    assert finish([], FakePlace({}, at_once=2)) == []


def test_what_a_dying_worker_took_with_it_is_tried_again_behind_the_others() -> None:
    place = FakePlace({1: 1}, at_once=3, gather=(3,))
    finished = finish([0, 1, 2, 3, 4, 5, 6, 7], place)
    assert sorted(finished) == list(range(8))  # each once: what had finished with the dying one stays finished
    assert place.n_opened == 2
    assert finished.index(1) > finished.index(5)


def test_a_unit_that_kills_each_worker_is_named_and_the_others_are_finished() -> None:
    place = FakePlace({3: 99}, at_once=2)
    finished: list[int] = []
    with pytest.raises(UsageError, match=rf"unit 3: workers died {ATTEMPTS} times with it, the last time alone"):
        finish_units(
            range(6),
            place,
            lambda executor, unit: executor.submit(lambda n: n, unit),
            lambda unit, result: finished.append(unit),
        )
    assert sorted(finished) == [0, 1, 2, 4, 5]
    assert place.n_opened == ATTEMPTS


def test_the_last_attempt_is_made_alone() -> None:
    """Two units that were there each time workers died: only the guilty one is blamed."""
    place = FakePlace({0: ATTEMPTS - 1}, at_once=2, gather=(2,) * (ATTEMPTS - 1))
    assert sorted(finish([0, 1], place)) == [0, 1]
    assert place.n_opened == ATTEMPTS
    assert place.together == [1, 2] * (ATTEMPTS - 1) + [1, 1]


def test_an_error_of_a_unit_ends_the_job() -> None:
    place = FakePlace({}, at_once=2)
    with pytest.raises(ZeroDivisionError):
        finish_units([1], place, lambda executor, n: executor.submit(lambda n: n // 0, n), lambda unit, result: None)


def test_a_place_can_explain_and_check() -> None:
    class Lost(FakePlace):
        def explain(self, error: BaseException) -> str | None:
            return "the scheduler is gone" if isinstance(error, CancelledError) else None

        def run_all(self, fn: Any) -> None:
            for future, _ in self.under_way:
                future.cancel()
                future.set_running_or_notify_cancel()

    with pytest.raises(UsageError, match="unit 0: the scheduler is gone; finished shards are kept: run"):
        finish([0], Lost({}, at_once=1))


def die(unit: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return unit


def nap(unit: int) -> int:
    time.sleep(30)
    return unit


def test_processes_that_die_end_in_one_clear_error() -> None:
    with pytest.raises(UsageError, match=f"unit 7: workers died {ATTEMPTS} times"):
        finish_units([7], ProcessPool(2), lambda executor, unit: executor.submit(die, unit), lambda unit, result: None)


def test_processes_end_at_once_when_the_job_stops() -> None:
    started = time.monotonic()
    with suppress(KeyboardInterrupt), ProcessPool(2).open(lambda unit, n_done: None) as executor:
        futures = [executor.submit(nap, unit) for unit in range(4)]
        deadline = time.monotonic() + 20
        while not any(future.running() for future in futures) and time.monotonic() < deadline:
            time.sleep(0.05)
        raise KeyboardInterrupt
    assert time.monotonic() - started < 20
    assert all(future.done() for future in futures)
