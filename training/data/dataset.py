"""Shards to batches of training samples: an endless, numbered sequence of draws.

The sample of draw n and its jitter depend only on the seed and on n, not on the number of worker processes or on where
a training was interrupted.
"""

from collections.abc import Mapping
from typing import final

import numpy as np
from torch import Tensor

from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.jitter import draw_jitter, jitter_crop
from training.data.batches import Batch, Draws, Layout, batch_layout, batch_of, batch_row
from training.data.cropping import cut, cut_around_box, resample, vary_colours
from training.data.decoded_sample import DecodedSample, decode_sample
from training.data.draw_order import JITTER_STREAM, DrawOrder
from training.data.halving import halved
from training.data.shard_index import ShardIndex
from training.data.shared_cache import SharedCache
from training.recipe.recipe import Recipe


@final
class DrawDataset(Draws[Batch]):
    """Numbered draws from shards. ``cache_bytes`` is for decoded samples, for all processes that load together."""

    def __init__(self, shards: ShardIndex, recipe: Recipe, cache_bytes: int = 0) -> None:
        self._recipe, self._has_seen = recipe, shards.knows_seen
        self._order = DrawOrder(shards.sets, recipe.seed)
        self._samples = SampleStore(shards, recipe, cache_bytes)

    def __getitem__(self, draw: int) -> Batch:
        """One draw, as a batch of one."""
        return self.batch([draw])

    def layout(self, n_samples: int) -> Layout:
        """The tensors of a batch."""
        recipe = self._recipe
        return batch_layout(n_samples, recipe.size_px, has_seen=self._has_seen, n_landmarks=recipe.n_landmarks)

    def of_tensors(self, tensors: Mapping[str, Tensor]) -> Batch:
        """The batch that has these tensors."""
        return batch_of(tensors)

    def fill_row(self, batch: Batch, place: int, draw: int) -> None:
        """Fills a row of a batch."""
        recipe, row = self._recipe, batch_row(batch, place)
        sample = self._samples.get(self._order.sample_of(draw))
        rng = np.random.default_rng([JITTER_STREAM, recipe.seed, draw])
        jitter = draw_jitter(rng, recipe.jitter)
        if recipe.cropping == "full":
            crop = jitter_crop(FaceBox.around(sample.landmarks2d), jitter, len(row.image))
            resample(sample, crop, row)
        else:
            corner = middle_corner(sample, len(row.image))
            if recipe.cropping != "none":
                height, width = sample.image.shape[:2]
                corner = int(rng.integers(width - len(row.image) + 1)), int(rng.integers(height - len(row.image) + 1))
            cut(sample, corner, row, mirror=jitter.mirror)
        if recipe.cropping != "none":
            vary_colours(row.image, jitter)


def middle_corner(sample: DecodedSample, size_px: int) -> tuple[int, int]:
    """Column and row of the first pixel of the square in the middle of a picture."""
    height, width = sample.image.shape[:2]
    return (width - size_px) // 2, (height - size_px) // 2


@final
class SampleStore:
    """Decoded samples by number, prepared for the recipe's ``cropping``.

    For full they are left as they are, for box they are cut to a square around each face. The other kinds cut squares
    of ``size_px`` from them, so samples of at least twice this size are halved.
    """

    def __init__(self, shards: ShardIndex, recipe: Recipe, cache_bytes: int = 0) -> None:
        self._shards, self._recipe = shards, recipe
        self._cache = SharedCache(len(shards.shard), cache_bytes) if cache_bytes else None
        self._checked: set[int] = set()

    def get(self, number: int) -> DecodedSample:
        """A sample, from the cache where it is there.

        Raises:
            InputFileError: It is damaged, or ``cropping`` needs a box of its landmarks and they have none.
            UsageError: Its picture is too small to be cut from.
        """
        piece = None if self._cache is None else self._cache.get(number)
        if piece is not None:
            return DecodedSample.from_bytes(piece)
        sample = self._decode(number)
        if self._cache is not None:
            self._cache.put(number, sample.to_bytes())
        return sample

    def _decode(self, number: int) -> DecodedSample:
        reader, position = self._shards.readers[self._shards.shard[number]], int(self._shards.position[number])
        where, size_px = f"{reader.path}, sample {position}", self._recipe.size_px
        # The checksum is compared when a sample is read for the first time.
        sample = decode_sample(reader, position, is_checked=number not in self._checked)
        self._checked.add(number)
        if self._recipe.cropping in ("full", "box"):
            _check_has_box(sample, where)
            is_whole = self._recipe.cropping == "full"
            return sample if is_whole else cut_around_box(sample, number, size_px, self._recipe.crop_scale)
        height, width = sample.image.shape[:2]
        if min(height, width) < size_px:
            raise UsageError(
                f"{where}: expected a picture of at least {size_px} x {size_px} pixels to cut from, found "
                f"{width} x {height}; give --cropping full or box, which scale, or a smaller --size-px"
            )
        while min(sample.image.shape[:2]) >= 2 * size_px:
            sample = halved(sample)
        return sample


def _check_has_box(sample: DecodedSample, where: str) -> None:
    try:
        FaceBox.around(sample.landmarks2d)
    except DegenerateGeometryError as error:
        raise InputFileError(
            f"{where}: {error}; leave it out with --where, or give --cropping shift, which goes by no landmarks"
        ) from error
