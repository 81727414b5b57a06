"""How good the network is on faces that it is not trained on."""

from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from jaxtyping import Float32
from torch import Tensor, nn

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.face_fit import fit_face
from pix2face.geometry.landmark_metrics import nme
from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.predictor import read_planes
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.networks.paper import MAP_PLANES
from training.data.batches import Batch, network_input
from training.data.shard_index import ShardIndex
from training.loop.run_configuration import checkpoint_header
from training.loop.validation_set import ValidationSet
from training.recipe.recipe import Recipe

BATCH_SIZE = 16
# A fit that finds nothing counts as much as one that is off by the whole box.
NME_OF_FAILURE = 1.0


@final
@dataclass(frozen=True, kw_only=True)
class Scores:
    """Means over the faces held out.

    Attributes:
        pncc_mm: Distance of PNCC from the truth, over the true mask.
        offset_mm: Distance of offsets from the truth, over the true mask.
        offset_zero_mm: The same if all offsets were predicted as 0.
        mask_iou: Pixels in both the true and the predicted mask by pixels in one of them.
        nme: Error of 68 landmarks of the project's fit, as a fraction of sqrt(w h) of the true ones' box; None where
            the morphable model is not at hand.
    """

    pncc_mm: float
    offset_mm: float
    offset_zero_mm: float
    mask_iou: float
    nme: float | None

    @property
    def error(self) -> float:
        """What makes a checkpoint the best: the landmarks' error, or PNCC's where that is not known."""
        return self.pncc_mm if self.nme is None else self.nme

    def as_numbers(self) -> dict[str, float]:
        """By name, what is known."""
        numbers = {
            "pncc_mm": self.pncc_mm,
            "offset_mm": self.offset_mm,
            "offset_zero_mm": self.offset_zero_mm,
            "mask_iou": self.mask_iou,
        }
        return numbers if self.nme is None else numbers | {"nme": self.nme}


@final
class Validator:
    """Measures a network on faces held out, always the same crops without jitter.

    Args:
        header: What the network's checkpoint would say of it.
        held_out: The samples.
        model: The morphable model to fit; None measures the maps alone.
        every: So many samples of training lie between two measurements; None measures after each epoch.
    """

    def __init__(
        self,
        header: CheckpointHeader,
        held_out: ValidationSet,
        model: MorphableModel | None,
        every: int | None = None,
    ) -> None:
        self._header, self._held_out, self._model, self._every = header, held_out, model, every

    @property
    def scales_mm(self) -> tuple[float, float]:
        """PNCC's and offset's."""
        return self._header.pncc_scale_mm, self._header.offset_scale_mm

    def is_due(self, samples: int, step_samples: int, *, is_end: bool) -> bool:
        """Whether it is time to measure.

        Args:
            samples: Seen so far.
            step_samples: Of these in the last step.
            is_end: Whether this is the end of an epoch.
        """
        if self._every is None:
            return is_end
        return samples // self._every > (samples - step_samples) // self._every

    def first_batch(self) -> Batch:
        """Some samples, to look at."""
        return next(self._held_out.batches(BATCH_SIZE))

    def scores(self, network: nn.Module) -> Scores:
        """Measures a network; it is left in the state in which it was."""
        was_training = network.training
        device = next(network.parameters()).device
        rows: list[tuple[float, ...]] = []
        network.eval()
        with torch.inference_mode():
            for batch in self._held_out.batches(BATCH_SIZE):
                planes = network(network_input(batch.to(device))).float().cpu()
                for own, sample in zip(planes, range(len(batch)), strict=True):
                    rows.append(self._measure(own, batch.rows(sample, sample + 1), len(rows)))
        network.train(was_training)
        pncc_mm, offset_mm, zero_mm, iou, error = (float(mean) for mean in np.array(rows).mean(axis=0))
        return Scores(
            pncc_mm=pncc_mm,
            offset_mm=offset_mm,
            offset_zero_mm=zero_mm,
            mask_iou=iou,
            nme=None if self._model is None else error,
        )

    def _measure(self, planes: Float32[Tensor, "planes s s"], truth: Batch, index: int) -> tuple[float, ...]:
        mask = truth.mask[0].bool()
        size = mask.sum().clamp(min=1)
        errors_mm = []
        pairs = (planes[:3], truth.pncc), (planes[3:MAP_PLANES], truth.offset)
        for (predicted, steps), scale_mm in zip(pairs, self.scales_mm, strict=True):
            true_mm = steps[0] / FIXED_POINT_STEPS_PER_MM
            errors_mm.append(float((predicted * scale_mm - true_mm).norm(dim=0)[mask].sum() / size))
        zero_mm = float((truth.offset[0] / FIXED_POINT_STEPS_PER_MM).norm(dim=0)[mask].sum() / size)
        found = read_planes(np.ascontiguousarray(planes.permute(1, 2, 0).numpy()), self._header).maps
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
    """What measures the networks of a training.

    Args:
        held_out: Samples of persons that are not trained on.
        recipe: Of the training.
        most: How many samples to take at most.
        every: So many samples of training lie between two measurements; None measures after each epoch.
    """
    builtin = builtin_model()
    return Validator(
        checkpoint_header(held_out, recipe, "", 0, 0),
        ValidationSet(held_out, recipe, most),
        builtin if builtin.sha256 == held_out.model_sha256 else None,
        every,
    )
