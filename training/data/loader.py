"""Batches in time: loaded ahead by processes, with a clock that says how long the trainer waited for them."""

import time
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from typing import Generic, final

from pix2face.errors import UsageError
from training.data.batches import B, Draws
from training.data.draw_order import draws_of_batches
from training.data.loading_processes import LoadingProcesses


@final
class DrawLoader(Generic[B]):
    """Loads the batches of a training.

    Args:
        draws: Where batches come from.
        batch_size: Pictures a batch, over all machines.
        workers: Processes that load; 0 loads between steps.
        pin_memory: Put batches where a GPU can fetch them.
        rank: Of this machine, from 0; it gets its part of each batch.
        n_ranks: How many machines there are.

    Attributes:
        wait_seconds: How long callers have waited for batches so far.

    Raises:
        UsageError: A batch cannot be divided among the machines.
    """

    def __init__(
        self,
        draws: Draws[B],
        batch_size: int,
        *,
        workers: int,
        pin_memory: bool = False,
        rank: int = 0,
        n_ranks: int = 1,
    ) -> None:
        if batch_size % n_ranks:
            raise UsageError(
                f"expected batches that {n_ranks} processes can share, found {batch_size} pictures a batch; give a "
                f"multiple of {n_ranks}"
            )
        self.wait_seconds = 0.0
        self._draws, self._batch_size, self._rank, self._n_ranks = draws, batch_size, rank, n_ranks
        self._workers, self._pin_memory = workers, pin_memory

    def batches(self, first_draw: int, n_batches: int) -> Generator[B, None, None]:
        """Some batches, from a draw on. Ask for all that are left of a training: workers then never run dry.

        Close what it returns (``contextlib.closing``) to end the workers before all batches were taken.

        Raises:
            InputFileError: A sample is damaged.
            Pix2FaceError: A worker died.
        """
        with closing(self._loaded(first_draw, n_batches)) as loaded:
            batches = _pinned(loaded) if self._pin_memory else loaded
            began = time.perf_counter()
            for batch in batches:
                self.wait_seconds += time.perf_counter() - began
                yield batch
                began = time.perf_counter()

    def _loaded(self, first_draw: int, n_batches: int) -> Generator[B, None, None]:
        draws = draws_of_batches(first_draw, n_batches, self._batch_size, self._rank, self._n_ranks)
        if not self._workers or not n_batches:
            yield from map(self._draws.batch, draws)
            return
        processes = LoadingProcesses(self._draws, self._workers)
        try:
            yield from processes.batches(draws)
        finally:
            processes.end()


def _pinned(batches: Iterator[B]) -> Iterator[B]:
    """Copies each batch to pinned memory in a thread, while the batch before is in use."""

    def following() -> B | None:
        batch = next(batches, None)
        return None if batch is None else batch.pin_memory()

    with ThreadPoolExecutor(1) as thread:
        coming = thread.submit(following)
        while (batch := coming.result()) is not None:
            coming = thread.submit(following)
            yield batch
