"""The samples of a training, decoded and kept."""

import os
from typing import Any, final

from pix2face.crops import FaceBox
from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from training.decoded_sample import TRAINED_LAYERS, DecodedSample, decode_sample
from training.halving import halved
from training.sample_files import SampleFiles
from training.shard_index import ShardIndex
from training.shared_cache import SharedCache


@final
class SampleStore:
    """Decoded samples by number.

    Args:
        shards: Where they are.
        cut_px: Side of the squares that are to be cut from them: they are halved while they are twice as large as
            that, or more. 0 leaves them as they are.
        cache: Keeps what was decoded, for this process and others; None keeps nothing.
    """

    def __init__(self, shards: ShardIndex, cut_px: int, cache: SharedCache | None = None) -> None:
        self._shards = shards
        self._cut_px = cut_px
        self._cache = cache
        self._forget()

    def __getstate__(self) -> dict[str, Any]:
        """Another process gets the plan, not the open files."""
        return {"shards": self._shards, "cut_px": self._cut_px, "cache": self._cache}

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
        sample = self._decode(int(self._shards.shard[number]), int(self._shards.position[number]))
        if self._cache is not None:
            self._cache.put(number, sample.to_bytes())
        return sample

    def _decode(self, shard: int, position: int) -> DecodedSample:
        if os.getpid() != self._process:
            self._forget()  # a forked HDF5 handle would share its file position with the parent
        where = f"{self._shards.paths[shard]}, sample {position}"
        sample = decode_sample(self._files.read(shard, position), where)
        height, width = sample.image.shape[:2]
        if min(height, width) < self._cut_px:
            raise UsageError(
                f"{where}: expected a picture of at least {self._cut_px} x {self._cut_px} pixels to cut from, found "
                f"{width} x {height}; give --cropping full, which scales, or a smaller --size-px"
            )
        if not self._cut_px:
            _check_has_box(sample, where)
        while self._cut_px and min(sample.image.shape[:2]) >= 2 * self._cut_px:
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
