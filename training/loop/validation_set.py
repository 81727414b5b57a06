"""The samples that a training validates with: a fixed list, each always the same crop, in its own colours."""

from collections.abc import Iterator
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray

from pix2face.geometry.crops import Crop, FaceBox, square_crop
from training.data.batches import Batch, batch_row, empty_batch
from training.data.cropping import cut, resample
from training.data.dataset import SampleStore, middle_corner
from training.data.shard_index import ShardIndex
from training.recipe.recipe import Recipe

# The error's own uncertainty is then below a twentieth of it, and a measurement takes less than a minute.
MOST_SAMPLES = 512


@final
class ValidationSet:
    """Samples of persons that are not trained on (``shard_index.split_off``).

    They are cut as at inference where the recipe crops in full, else from the middle: of the square around their boxes
    (``cropping.cut_around_box``), or of the picture.

    Args:
        shards: The samples held out.
        recipe: Of the training: size and way of cropping.
        most: How many samples to take at most; which ones depends on whom they show alone.
    """

    def __init__(self, shards: ShardIndex, recipe: Recipe, most: int = MOST_SAMPLES) -> None:
        self._shards = shards
        self._recipe = recipe
        self._samples = SampleStore(shards, recipe)
        by_person = shards.samples[np.argsort(shards.person[shards.samples], kind="stable")]
        self.numbers: Int64[ndarray, " n"] = np.sort(by_person[:most])

    def __len__(self) -> int:
        return len(self.numbers)

    def batches(self, batch_size: int) -> Iterator[Batch]:
        """All samples once, always in the same order.

        Raises:
            InputFileError: A sample is damaged.
        """
        for first in range(0, len(self), batch_size):
            numbers = self.numbers[first : first + batch_size].tolist()
            batch = empty_batch(len(numbers), self._recipe.size_px, has_seen=self._shards.knows_seen)
            for place, number in enumerate(numbers):
                sample, row = self._samples.get(number), batch_row(batch, place)
                if self._recipe.cropping == "full":
                    resample(sample, inference_crop(sample.landmarks2d, self._recipe), row)
                else:
                    cut(sample, middle_corner(sample, len(row.image)), row, mirror=False)
            yield batch

    @cached_property
    def landmarks2d(self) -> Float32[ndarray, "n m 2"]:
        """The landmarks of each sample, pixels of the network's input."""
        found = []
        for number in self.numbers.tolist():
            sample = self._samples.get(number)
            if self._recipe.cropping == "full":
                found.append(inference_crop(sample.landmarks2d, self._recipe).to_crop(sample.landmarks2d))
            else:
                found.append(sample.landmarks2d - middle_corner(sample, self._recipe.size_px))
        return np.stack(found).astype(np.float32)


def inference_crop(landmarks2d: Float32[ndarray, "m 2"], recipe: Recipe) -> Crop:
    """The crop that a network is given of a face when it is used."""
    return square_crop(FaceBox.around(landmarks2d), recipe.crop_scale, recipe.size_px)
