"""Measures the network on faces that it is not trained on."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import final

import numpy as np
import torch
from jaxtyping import Float32, Int64
from numpy import ndarray
from torch import Tensor, nn

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.face_fit import fit_face
from pix2face.geometry.crops import Crop, FaceBox, square_crop
from pix2face.geometry.landmark_metrics import nme
from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.predictor import read_landmarks, read_planes
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.networks import MAP_PLANES
from training.data.batches import Batch, as_input, batch_row, empty_batch
from training.data.cropping import cut, resample
from training.data.dataset import SampleStore, middle_corner
from training.data.shard_index import ShardIndex
from training.loop.run_configuration import checkpoint_header
from training.recipe.recipe import Recipe

# The error's own uncertainty is then below a twentieth of it, and a measurement takes less than a minute.
MOST_SAMPLES = 512
BATCH_SIZE = 16
# A fit that fails counts as much as one that is off by the whole box.
NME_OF_FAILURE = 1.0


@final
class ValidationSet:
    """Samples of persons that are not trained on (``shard_index.split_off``).

    They are cropped as at inference where the recipe crops in full. Otherwise they are the middle of the square around
    their boxes (``cropping.cut_around_box``), or of the picture. At most ``most`` samples are taken, and which ones
    depends only on the persons.
    """

    def __init__(self, shards: ShardIndex, recipe: Recipe, most: int = MOST_SAMPLES) -> None:
        self._shards, self._recipe, self._samples = shards, recipe, SampleStore(shards, recipe)
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


@final
@dataclass(frozen=True, kw_only=True)
class Scores:
    """Means over the faces that were held out."""

    pncc_mm: float  # distance of PNCC from the truth, over the true mask
    offset_mm: float  # distance of offsets from the truth, over the true mask
    offset_zero_mm: float  # the same for offsets of 0
    mask_iou: float  # pixels in both the true and the predicted mask, divided by pixels in either
    # Error of the 68 fitted landmarks, as a fraction of sqrt(w h) of the true landmarks' box; None where the morphable
    # model is not at hand.
    nme: float | None
    landmark_nme: float | None = None  # the same error of the landmarks that the network predicts itself, if it does

    @property
    def error(self) -> float:
        """The number by which the best checkpoint is chosen: the error of the landmarks, or of PNCC if unknown."""
        return self.pncc_mm if self.nme is None else self.nme

    def as_numbers(self) -> dict[str, float]:
        """The known scores by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@final
class Validator:
    """Measures a network on faces that were held out, always with the same crops and without jitter.

    Args:
        header: The header of the network's checkpoint.
        held_out: The samples.
        model: The morphable model to fit; None measures only the maps.
        every: Number of training samples between two measurements; None measures after each epoch.
    """

    def __init__(
        self, header: CheckpointHeader, held_out: ValidationSet, model: MorphableModel | None, every: int | None = None
    ) -> None:
        self._header, self._held_out, self._model, self._every = header, held_out, model, every

    @property
    def scales_mm(self) -> tuple[float, float]:
        """The scales of PNCC and offset."""
        return self._header.pncc_scale_mm, self._header.offset_scale_mm

    def is_due(self, samples: int, step_samples: int, *, is_end: bool) -> bool:
        """Whether to measure after a step of ``step_samples`` samples, of ``samples`` so far."""
        if self._every is None:
            return is_end
        return samples // self._every > (samples - step_samples) // self._every

    def first_batch(self) -> Batch:
        """Some samples, to look at."""
        return next(self._held_out.batches(BATCH_SIZE))

    def scores(self, network: nn.Module) -> Scores:
        """Measures a network, and leaves it in its mode."""
        was_training = network.training
        device = next(network.parameters()).device
        rows: list[tuple[float, ...]] = []
        network.eval()
        with torch.inference_mode():
            for batch in self._held_out.batches(BATCH_SIZE):
                answer = network(as_input(batch.image.to(device)))
                planes, landmarks = answer if isinstance(answer, tuple) else (answer, None)
                for index, own in enumerate(planes.float().cpu()):
                    measured = self._measure(own, batch[index : index + 1], len(rows))
                    points = None if landmarks is None else landmarks[index].float().cpu().numpy()
                    rows.append((*measured, self._landmark_error(points, len(rows))))
        network.train(was_training)
        pncc_mm, offset_mm, zero_mm, iou, error, direct = (float(mean) for mean in np.array(rows).mean(axis=0))
        return Scores(
            pncc_mm=pncc_mm,
            offset_mm=offset_mm,
            offset_zero_mm=zero_mm,
            mask_iou=iou,
            nme=None if self._model is None else error,
            landmark_nme=direct if self._header.n_landmarks else None,
        )

    def _landmark_error(self, numbers: Float32[ndarray, "n 3"] | None, index: int) -> float:
        found = None if numbers is None else read_landmarks(numbers, self._header.size_px)
        if found is None:
            return 0.0
        return min(nme(found.points2d, self._held_out.landmarks2d[index], "box-sqrt"), NME_OF_FAILURE)

    def _measure(self, planes: Float32[Tensor, "planes s s"], truth: Batch, index: int) -> tuple[float, ...]:
        mask = truth.mask[0].bool()
        size = mask.sum().clamp(min=1)
        errors_mm = []
        pairs = (planes[:3], truth.pncc), (planes[3:MAP_PLANES], truth.offset)
        for (predicted, steps), scale_mm in zip(pairs, self.scales_mm, strict=True):
            true_mm = steps[0] / FIXED_POINT_STEPS_PER_MM
            errors_mm.append(float((predicted * scale_mm - true_mm).norm(dim=0)[mask].sum() / size))
        zero_mm = float((truth.offset[0] / FIXED_POINT_STEPS_PER_MM).norm(dim=0)[mask].sum() / size)
        found, _ = read_planes(np.ascontiguousarray(planes.permute(1, 2, 0).numpy()), self._header)
        true_mask = mask.numpy()
        union = (found.mask | true_mask).sum()
        iou = float((found.mask & true_mask).sum() / max(union, 1))
        error = 0.0
        if self._model is not None:
            try:
                fit = fit_face(found, self._model)
                error = min(nme(fit.landmarks2d, self._held_out.landmarks2d[index], "box-sqrt"), NME_OF_FAILURE)
            except DegenerateGeometryError:
                error = NME_OF_FAILURE
        return *errors_mm, zero_mm, iou, error


def validator_of(held_out: ShardIndex, recipe: Recipe, most: int, every: int | None) -> Validator:
    """The validator of a training, which fits the morphable model if it is the built-in one."""
    builtin = builtin_model()
    model = builtin if builtin.sha256 == held_out.model_sha256 else None
    header = checkpoint_header(held_out, recipe, "", 0, 0)
    return Validator(header, ValidationSet(held_out, recipe, most), model, every)
