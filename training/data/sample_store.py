"""The samples of a training, decoded and kept."""

import os
from typing import Any, final

from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.geometry.crops import FaceBox
from training.data.box_cut import cut_around_box
from training.data.decoded_sample import TRAINED_LAYERS, DecodedSample, decode_sample
from training.data.halving import halved
from training.data.sample_files import SampleFiles
from training.data.shard_index import ShardIndex
from training.data.shared_cache import SharedCache
from training.recipe.recipe import Recipe


@final
class SampleStore:
    """Decoded samples by number.

    Args:
        shards: Where they are.
        recipe: What is done with them: ``cropping`` full wants them as they are, box a square around each face; the
            others cut squares of ``size_px`` from them, so they are halved while they are twice as large, or more.
        cache: Keeps what was decoded, for this process and others; None keeps nothing.
    """

    def __init__(self, shards: ShardIndex, recipe: Recipe, cache: SharedCache | None = None) -> None:
        self._shards = shards
        self._recipe = recipe
        self._cache = cache
        self._forget()

    def __getstate__(self) -> dict[str, Any]:
        """Another process gets the plan, not the open files."""
        return {"shards": self._shards, "recipe": self._recipe, "cache": self._cache}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)

    def get(self, number: int) -> DecodedSample:
        """A sample, from the cache where it is there.

        Raises:
            InputFileError: It is damaged, or crops go by a box that its landmarks have not.
            UsageError: Its picture is smaller than what is to be cut from it.
        """
        piece = None if self._cache is None else self._cache.get(number)
        if piece is not None:
            return DecodedSample.from_bytes(piece)
        sample = self._decode(number)
        if self._cache is not None:
            self._cache.put(number, sample.to_bytes())
        return sample

    def _decode(self, number: int) -> DecodedSample:
        if os.getpid() != self._process:
            self._forget()  # a forked HDF5 handle would share its file position with the parent
        shard, position = int(self._shards.shard[number]), int(self._shards.position[number])
        where = f"{self._shards.paths[shard]}, sample {position}"
        sample, size_px = decode_sample(self._files.read(shard, position), where), self._recipe.size_px
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

    def _forget(self) -> None:
        self._process = os.getpid()
        self._files = SampleFiles(self._shards.paths, self._shards.spans, TRAINED_LAYERS)


def _check_has_box(sample: DecodedSample, where: str) -> None:
    try:
        FaceBox.around(sample.landmarks2d)
    except DegenerateGeometryError as error:
        raise InputFileError(
            f"{where}: {error}; leave it out with --where, or give --cropping shift, which goes by no landmarks"
        ) from error
