"""Finishes units of work at a place that may lose its workers.

A worker that dies (killed, out of memory) takes its whole pool with it. A new pool is opened, and the units that were
under way are tried again after all others. The last attempt of a unit is made alone, so that the blame is certain; if
its worker dies again, the job ends.
"""

from collections import Counter, deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from typing import Generic, TypeVar, final

from datagen.jobs.executors import WorkPlace
from datagen.process_pool import OnReport
from pix2face.errors import UsageError

# How many times workers may die with a unit in their hands.
ATTEMPTS = 3
CHECK_EVERY_S = 5.0

Result = TypeVar("Result")


def finish_units(
    units: Iterable[int],
    place: WorkPlace,
    submit: Callable[[Executor, int], "Future[Result]"],
    on_finished: Callable[[int, Result], None],
    on_report: OnReport = lambda unit, n_done: None,
) -> None:
    """Finishes all units, in any order, and passes number and result of each to ``on_finished`` in the caller's thread.

    Meanwhile ``on_report`` is told, in another thread, how much of a unit is done: less than before if it is tried
    again.

    Raises:
        UsageError: Workers died with a unit too often, or no worker is left.
        Exception: Whatever a unit raised. The other units are dropped.
    """
    work = _Work(units, submit, on_finished)
    while work.waiting:
        try:
            with place.open(on_report) as executor:
                _drain(work, place, executor)
        except BrokenExecutor:
            work.return_lost()


@final
class _Work(Generic[Result]):
    """The units that wait, those under way, and how often workers died with each."""

    def __init__(
        self,
        units: Iterable[int],
        submit: Callable[[Executor, int], "Future[Result]"],
        on_finished: Callable[[int, Result], None],
    ) -> None:
        self.waiting = deque(units)
        self.running: dict[Future[Result], int] = {}
        self.submit, self.on_finished = submit, on_finished
        self._deaths: Counter[int] = Counter()

    def hand_over(self, executor: Executor, at_once: int) -> None:
        """Hands over as many units as may be under way. The last attempt of a unit is made alone."""
        while self.waiting:
            alone = any(self._is_last_attempt(unit) for unit in (self.waiting[0], *self.running.values()))
            if len(self.running) >= (1 if alone else at_once):
                return
            self.running[self.submit(executor, self.waiting[0])] = self.waiting[0]
            self.waiting.popleft()

    def return_lost(self) -> None:
        """Puts the units that were under way when a worker died behind all others.

        Raises:
            UsageError: Workers have died with one of them too often.
        """
        for future in [future for future in self.running if not future.cancelled() and future.exception() is None]:
            self.on_finished(self.running.pop(future), future.result())  # finished in the same moment
        lost = sorted(self.running.values())
        self.running.clear()
        self._deaths.update(lost)
        self.waiting.extend(lost)
        guilty = [unit for unit in lost if self._deaths[unit] >= ATTEMPTS]
        if guilty:
            raise UsageError(
                f"unit {guilty[0]}: workers died {ATTEMPTS} times with it, the last time alone (out of memory? a "
                "driver that crashes? see `datagen doctor`); all other finished shards are kept: run the same command "
                "again to go on"
            )

    def _is_last_attempt(self, unit: int) -> bool:
        return self._deaths[unit] >= ATTEMPTS - 1


def _drain(work: _Work[Result], place: WorkPlace, executor: Executor) -> None:
    while work.waiting or work.running:
        work.hand_over(executor, place.at_once)
        done, _ = wait(work.running, timeout=CHECK_EVERY_S, return_when=FIRST_COMPLETED)
        if not done:
            place.check()
        for future in done:
            try:
                result = future.result()
            except BrokenExecutor:
                raise  # the unit stays among the running: it is tried again
            except Exception as error:
                explained = place.explain(error)
                if explained is None:
                    raise
                raise UsageError(
                    f"unit {work.running[future]}: {explained}; finished shards are kept: run the same command again"
                ) from error
            work.on_finished(work.running.pop(future), result)
