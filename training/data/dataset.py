"""Shards to batches of training samples: an endless, numbered sequence of draws.

Draw number n is the same sample with the same jitter whoever computes it: it depends on the seed and on n only, not on
the number of worker processes or on where a training was interrupted.
"""

from collections.abc import Sequence
from typing import final

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from pix2face.geometry.crops import FaceBox
from pix2face.geometry.jitter import draw_jitter, jitter_crop
from training.data.batch_rows import BatchRow, cut, resample, vary_colours
from training.data.batches import Batch
from training.data.decoded_sample import DecodedSample
from training.data.draw_order import JITTER_STREAM, DrawOrder
from training.data.sample_store import SampleStore
from training.data.shard_index import ShardIndex
from training.data.shared_cache import SharedCache
from training.recipe.recipe import Recipe


@final
class TripletDataset(Dataset[Batch]):
    """Numbered draws from shards, a batch at a time.

    Args:
        shards: Where the samples are.
        recipe: Size, seed and jitter.
        cache: Keeps decoded samples, for this process and others; None keeps nothing.
    """

    def __init__(self, shards: ShardIndex, recipe: Recipe, cache: SharedCache | None = None) -> None:
        self._recipe = recipe
        self._order = DrawOrder(shards.sets, recipe.seed)
        self._samples = SampleStore(shards, recipe, cache)
        self._has_seen = shards.knows_seen
        self._n_samples = len(shards)

    def __len__(self) -> int:
        return self._n_samples

    def __getitem__(self, draw: int) -> Batch:
        """One draw, as a batch of one."""
        return self.__getitems__([draw])

    def __getitems__(self, draws: Sequence[int]) -> Batch:
        """Some draws, by their numbers from 0 without end.

        Raises:
            InputFileError: A sample is damaged.
            UsageError: A picture is smaller than what is to be cut from it.
        """
        batch = empty_batch(len(draws), self._recipe.size_px, has_seen=self._has_seen)
        for place, draw in enumerate(draws):
            self._fill(batch_row(batch, place), draw)
        return batch

    def _fill(self, row: BatchRow, draw: int) -> None:
        recipe = self._recipe
        sample = self._samples.get(self._order.sample_of(draw))
        rng = np.random.default_rng([JITTER_STREAM, recipe.seed, draw])
        jitter = draw_jitter(rng, recipe.jitter)
        if recipe.cropping == "full":
            crop = jitter_crop(FaceBox.around(sample.landmarks2d), jitter, row.size_px)
            resample(sample, crop, row)
        else:
            corner = middle_corner(sample, row.size_px)
            if recipe.cropping != "none":
                height, width = sample.image.shape[:2]
                corner = int(rng.integers(width - row.size_px + 1)), int(rng.integers(height - row.size_px + 1))
            cut(sample, corner, row, mirror=jitter.mirror)
        if recipe.cropping != "none":
            vary_colours(row.image, jitter)


def middle_corner(sample: DecodedSample, size_px: int) -> tuple[int, int]:
    """Column and row of the first pixel of the square in the middle of a picture."""
    height, width = sample.image.shape[:2]
    return (width - size_px) // 2, (height - size_px) // 2


def empty_batch(n_samples: int, size_px: int, *, has_seen: bool) -> Batch:
    """A batch full of 0, channels last in memory."""

    def planes(dtype: torch.dtype) -> Tensor:
        return torch.zeros(n_samples, size_px, size_px, 3, dtype=dtype).permute(0, 3, 1, 2)

    return Batch(
        image=planes(torch.uint8),
        pncc=planes(torch.int16),
        offset=planes(torch.int16),
        mask=torch.zeros(n_samples, size_px, size_px, dtype=torch.uint8),
        seen=torch.zeros(n_samples, size_px, size_px, dtype=torch.uint8) if has_seen else None,
    )


def batch_row(batch: Batch, place: int) -> BatchRow:
    """The place of one sample in a batch, to be written to."""
    return BatchRow(
        image=batch.image[place].permute(1, 2, 0).numpy(),
        pncc=batch.pncc[place].permute(1, 2, 0).numpy(),
        offset=batch.offset[place].permute(1, 2, 0).numpy(),
        mask=batch.mask[place].numpy(),
        seen=None if batch.seen is None else batch.seen[place].numpy(),
    )
