"""Batches in time: loaded ahead by processes, with a clock that says how long the trainer waited for them."""

import time
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from typing import Generic, final

from training.data.batches import Batch
from training.data.dataset import DrawDataset
from training.data.draw_order import DrawBatches
from training.data.loading_processes import B, Draws, LoadingProcesses
from training.data.shard_index import ShardIndex
from training.data.shared_cache import SharedCache
from training.recipe.recipe import Recipe


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
        self.wait_seconds = 0.0
        self._draws = DrawBatches(batch_size, rank, n_ranks)
        self._dataset = draws
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
        draws = self._draws.plan(first_draw, n_batches)
        if not self._workers or not n_batches:
            yield from map(self._dataset.batch, draws)
            return
        processes = LoadingProcesses(self._dataset, self._workers)
        try:
            yield from processes.batches(draws)
        finally:
            processes.end()


@final
class BatchLoader(DrawLoader[Batch]):
    """Loads crops of the samples of shards, as a recipe has them; ``cache_bytes`` is for all workers together."""

    def __init__(
        self,
        shards: ShardIndex,
        recipe: Recipe,
        *,
        workers: int,
        cache_bytes: int,
        pin_memory: bool = False,
        rank: int = 0,
        n_ranks: int = 1,
    ) -> None:
        cache = SharedCache(len(shards.shard), cache_bytes) if cache_bytes else None
        draws = DrawDataset(shards, recipe, cache)
        super().__init__(draws, recipe.batch_size, workers=workers, pin_memory=pin_memory, rank=rank, n_ranks=n_ranks)


def _pinned(batches: Iterator[B]) -> Iterator[B]:
    """Copies each batch to pinned memory in a thread, while the batch before is in use."""

    def following() -> B | None:
        batch = next(batches, None)
        return None if batch is None else batch.pin_memory()  # type: ignore[return-value] # of the same kind

    with ThreadPoolExecutor(1) as thread:
        coming = thread.submit(following)
        while (batch := coming.result()) is not None:
            coming = thread.submit(following)
            yield batch
