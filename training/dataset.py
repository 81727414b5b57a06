"""Shards to training samples: an endless, numbered sequence of jittered crops.

Draw number n is the same sample with the same jitter whoever computes it: it depends on the seed and on n only, not on
the number of worker processes or on where a training was interrupted. Epoch e is the draws e * epoch_size onwards.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int16, Int64, UInt8
from numpy import ndarray
from torch import Tensor
from torch.utils.data import Dataset, Sampler

from pix2face.crops import Crop, FaceBox
from pix2face.face_maps import FaceMaps, fixed_point_to_maps
from pix2face.jitter import crop_maps, draw_jitter, jitter_crop, jitter_image
from pix2face.shards.shard_reader import ShardReader
from training.presets import Recipe
from training.shard_index import ShardIndex

# First word of the seeds of the two independent random streams.
ORDER_STREAM, JITTER_STREAM = 0, 1


@final
@dataclass(frozen=True, eq=False)
class DecodedSample:
    """A sample in memory: the picture, and the maps where there is a face.

    Attributes:
        image: RGB.
        pncc: Fixed point, cut to the mask's bounding box; so are the next two.
        offset: Fixed point.
        mask: Where both hold.
        corner: Top left corner (x, y) of the cut in the picture, px.
        box: Of the landmarks, in the picture.
    """

    image: UInt8[ndarray, "h w 3"]
    pncc: Int16[ndarray, "y x 3"]
    offset: Int16[ndarray, "y x 3"]
    mask: Bool[ndarray, "y x"]
    corner: tuple[int, int]
    box: FaceBox

    @property
    def bytes(self) -> int:
        """What it takes in memory."""
        return self.image.nbytes + self.pncc.nbytes + self.offset.nbytes + self.mask.nbytes


@final
class TripletDataset(Dataset[tuple[Tensor, Tensor]]):
    """Numbered draws from shards.

    Args:
        shards: Where the samples are.
        recipe: Size, seed and jitter.
        cache_bytes: How much decoded data this process may keep. What came first stays: in passes over all samples
            every place is asked for equally often.
    """

    def __init__(self, shards: ShardIndex, recipe: Recipe, cache_bytes: int = 0) -> None:
        self._shards = shards
        self._recipe = recipe
        self._cache_bytes = cache_bytes
        self._forget()

    def __len__(self) -> int:
        return len(self._shards)

    def __getstate__(self) -> dict[str, Any]:
        """A worker process gets the plan, not the open files."""
        return {"shards": self._shards, "recipe": self._recipe, "cache_bytes": self._cache_bytes}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)

    def __getitem__(self, draw: int) -> tuple[Float[Tensor, "3 s s"], Float[Tensor, "6 s s"]]:
        """One draw.

        Args:
            draw: Its number, from 0, without end.

        Returns:
            The picture in [-0.5, 0.5]; PNCC and offset divided by their scales, 0 in the background.
        """
        if os.getpid() != self._process:
            self._forget()  # a forked HDF5 handle would share its file position with the parent
        sample = self._decoded(self._sample_of(draw))
        rng = np.random.default_rng([JITTER_STREAM, self._recipe.seed, draw])
        jitter = draw_jitter(rng, self._recipe.jitter)
        crop = jitter_crop(sample.box, jitter, self._recipe.size_px)
        image = jitter_image(sample.image, crop, jitter)
        maps = crop_maps(
            FaceMaps(fixed_point_to_maps(sample.pncc), fixed_point_to_maps(sample.offset), sample.mask),
            _moved(crop, sample.corner),
        )
        pncc = _planes_first(maps.pncc) / self._shards.pncc_scale_mm
        offset = _planes_first(maps.offset) / self._shards.offset_scale_mm
        return _planes_first(image) - 0.5, torch.cat([pncc, offset])

    def _sample_of(self, draw: int) -> int:
        turn, place = divmod(draw, len(self))
        return int(_order(self._recipe.seed, turn, len(self))[place])

    def _decoded(self, sample: int) -> DecodedSample:
        if sample not in self._cache:
            decoded = self._decode(int(self._shards.shard[sample]), int(self._shards.position[sample]))
            if self._cached_bytes + decoded.bytes > self._cache_bytes:
                return decoded
            self._cached_bytes += decoded.bytes
            self._cache[sample] = decoded
        return self._cache[sample]

    def _decode(self, shard: int, position: int) -> DecodedSample:
        if shard not in self._readers:
            self._readers[shard] = ShardReader(self._shards.paths[shard])
        reader = self._readers[shard]
        box = FaceBox.around(reader.landmarks2d(position))
        cut = reader.face_cut(position)
        return DecodedSample(reader.image(position), cut.pncc, cut.offset, cut.mask, cut.corner, box)

    def _forget(self) -> None:
        self._process = os.getpid()
        self._readers: dict[int, ShardReader] = {}
        self._cache: dict[int, DecodedSample] = {}
        self._cached_bytes = 0


@final
class EpochDraws(Sampler[int]):
    """The draws of one epoch; set ``epoch`` before each."""

    def __init__(self, epoch_size: int) -> None:
        self.epoch = 0
        self._epoch_size = epoch_size

    def __len__(self) -> int:
        return self._epoch_size

    def __iter__(self) -> Iterator[int]:
        first = self.epoch * self._epoch_size
        return iter(range(first, first + self._epoch_size))


@lru_cache(maxsize=2)
def _order(seed: int, turn: int, count: int) -> Int64[ndarray, " n"]:
    """The order in which a pass over all samples takes them."""
    return np.random.default_rng([ORDER_STREAM, seed, turn]).permutation(count)


def _moved(crop: Crop, corner: tuple[int, int]) -> Crop:
    """The same crop in the frame of a picture whose origin is at ``corner``."""
    image_from_crop = crop.image_from_crop.copy()
    image_from_crop[:2, 2] -= corner
    return Crop(image_from_crop, crop.size_px)


def _planes_first(picture: Float[ndarray, "s s c"]) -> Float[Tensor, "c s s"]:
    return torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1)))
