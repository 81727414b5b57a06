"""The people of a scene: renders without their backdrop, in several sizes."""

from dataclasses import dataclass
from functools import lru_cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from pix2face.shards.layers import COVERAGE, IMAGE, LANDMARKS
from training.data.shard_index import ShardIndex

PEOPLE_LAYERS = (IMAGE, COVERAGE, LANDMARKS)
# A face of which less than this share is seen is neither to be found nor to be left alone.
LEAST_SEEN = 0.35
KEPT = 12_000  # renders that a process keeps: 200 kB each


@final
@dataclass(frozen=True, eq=False)
class Person:
    """One render."""

    rgba: UInt8[ndarray, "h w 4"]  # its picture, and how much of each pixel shows the person
    landmarks2d: Float64[ndarray, "68 2"]  # px, pixel centres at +0.5
    is_seen: bool  # whether enough of the face is seen
    has_environment: bool  # whether the backdrop is an environment


@final
class People:
    """Renders by number.

    Args:
        shards: With the layers of ``PEOPLE_LAYERS``.
    """

    def __init__(self, shards: ShardIndex) -> None:
        self._shards = shards
        self.get = lru_cache(KEPT)(self._read)

    def __len__(self) -> int:
        return self._shards.n_samples

    def _read(self, number: int) -> Person:
        """Reads a person.

        Raises:
            InputFileError: The sample is damaged.
        """
        reader = self._shards.readers[self._shards.shard[number]]
        sample = reader.read(int(self._shards.position[number]), PEOPLE_LAYERS)
        alpha = np.rint(255 * sample.layers[COVERAGE]).astype(np.uint8)
        return Person(
            rgba=np.dstack([sample.image, alpha]),
            landmarks2d=sample.landmarks2d.astype(np.float64),
            is_seen=float(sample.attributes.get("seen_share", 1.0)) >= LEAST_SEEN,
            has_environment="environment" in str(sample.attributes.get("backdrop.kind", "")),
        )


def halved(rgba: UInt8[ndarray, "h w 4"], factor: float) -> tuple[UInt8[ndarray, "_ _ 4"], float]:
    """Halves a picture until drawing it ``factor`` times as large skips no pixels; also returns what was divided by."""
    divided = 1.0
    while factor * divided < 0.6 and min(rgba.shape[:2]) > 8:
        rgba = cv2.resize(rgba, (rgba.shape[1] // 2, rgba.shape[0] // 2), interpolation=cv2.INTER_AREA)
        divided *= 2
    return rgba, divided
