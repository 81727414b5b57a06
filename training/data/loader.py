"""Batches in time: worker processes that load ahead, and a clock that says how long the trainer waited for them."""

import signal
import time
from collections.abc import Iterator
from typing import Any, final

import cv2
from torch.utils.data import DataLoader

from pix2face.errors import Pix2FaceError
from training.data.batches import Batch
from training.data.dataset import DrawDataset
from training.data.draw_order import DrawBatches
from training.data.shard_index import ShardIndex
from training.data.shared_cache import SharedCache
from training.recipe.recipe import Recipe

# Batches that each worker has ready or in work: enough to bridge the writing of a checkpoint.
PREFETCHED = 4


@final
class BatchLoader:
    """Loads the batches of a training.

    Args:
        shards: The samples.
        recipe: Size, seed, jitter, and pictures a batch (over all machines).
        workers: Processes that load; 0 loads between steps.
        cache_bytes: Memory for decoded samples, of all workers together.
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
        shards: ShardIndex,
        recipe: Recipe,
        *,
        workers: int,
        cache_bytes: int,
        pin_memory: bool = False,
        rank: int = 0,
        n_ranks: int = 1,
    ) -> None:
        self.wait_seconds = 0.0
        self._draws = DrawBatches(recipe.batch_size, rank, n_ranks)
        cache = SharedCache(len(shards.shard), cache_bytes) if cache_bytes else None
        self._loader: DataLoader[Batch] = DataLoader(
            DrawDataset(shards, recipe, cache),
            batch_sampler=self._draws,
            num_workers=workers,
            collate_fn=_as_it_is,  # the data set makes whole batches
            persistent_workers=workers > 0,
            prefetch_factor=PREFETCHED if workers else None,
            # Forking a process with threads may hang it.
            multiprocessing_context="spawn" if workers else None,
            worker_init_fn=_prepare_worker,
            pin_memory=pin_memory,
        )

    def batches(self, first_draw: int, n_batches: int) -> Iterator[Batch]:
        """Some batches, from a draw on. Ask for all that are left of a training: workers then never run dry.

        Raises:
            InputFileError: A sample is damaged.
        """
        self._draws.plan(first_draw, n_batches)
        try:
            began = time.perf_counter()
            for batch in self._loader:
                self.wait_seconds += time.perf_counter() - began
                yield batch
                began = time.perf_counter()
        except Pix2FaceError as error:
            # Where a worker wrapped its traceback around it, the error becomes one line again.
            last_line = str(error).strip().splitlines()[-1]
            raise type(error)(last_line.removeprefix(f"{type(error).__module__}.{type(error).__name__}: ")) from error


def _as_it_is(batch: Any) -> Any:
    return batch


def _prepare_worker(worker: int) -> None:
    """Makes a worker process a quiet one.

    Workers run side by side; OpenCV's threads in each of them would only be in each other's way. Signals to the whole
    group of processes are the trainer's to obey: it still wants a batch for the step under way, and ends the workers.
    """
    cv2.setNumThreads(1)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
