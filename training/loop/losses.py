"""The loss: a weighted mean of named parts."""

from dataclasses import asdict, dataclass
from typing import final

import torch
from jaxtyping import Float, Int16
from torch import Tensor
from torch.nn import functional

from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from pix2face.networks import MAP_PLANES
from training.data.batches import Batch
from training.recipe.recipe import LossOver, LossWeights


@final
@dataclass(frozen=True, kw_only=True)
class LossPlan:
    """Which planes are compared with which truth, and how."""

    pncc_scale_mm: float  # the first three planes of the network are PNCC divided by this
    offset_scale_mm: float  # the next three are offsets divided by this
    weights: LossWeights
    # Pixels over which the errors of the maps are averaged, in each picture by itself, so that every picture counts the
    # same and a batch is the mean of its parts.
    over: LossOver

    def parts(self, planes: Float[Tensor, "b planes s s"], batch: Batch) -> dict[str, Float[Tensor, ""]]:
        """The parts of the loss by name, unweighted. The batch must know ``seen`` where the loss needs it."""
        pncc, offset, *logits = torch.split(planes, [3, 3, *[1] * (planes.shape[1] - MAP_PLANES)], dim=1)
        parts = {
            "pncc": self._mean_error(pncc, batch.pncc, self.pncc_scale_mm, batch),
            "offset": self._mean_error(offset, batch.offset, self.offset_scale_mm, batch),
        }
        if logits:
            parts["mask"] = _cross_entropy(logits[0][:, 0], batch.mask)
        if len(logits) > 1:
            parts["seen"] = _cross_entropy(logits[1][:, 0], _seen(batch))
        return parts

    def total(self, parts: dict[str, Float[Tensor, ""]]) -> Float[Tensor, ""]:
        """The weighted mean of the parts. With equal weights, and maps alone, the mean over all six planes.

        Source: Crispell and Bazik 2017, Sec. 3.1 (L1 over both maps).
        """
        weights = asdict(self.weights)
        weighted = torch.stack([weights[name] * part for name, part in parts.items()])
        return weighted.sum() / sum(weights[name] for name in parts)

    def _mean_error(
        self, planes: Float[Tensor, "b 3 s s"], steps: Int16[Tensor, "b 3 s s"], scale_mm: float, batch: Batch
    ) -> Float[Tensor, ""]:
        # One pass changes type and memory layout; in two layouts the comparison would take twice as long.
        target = torch.empty_like(planes).copy_(steps).mul_(1 / (FIXED_POINT_STEPS_PER_MM * scale_mm))
        if self.over == "all":  # the background counts and should be 0
            return functional.l1_loss(planes, target)
        inside = (batch.mask if self.over == "mask" else _seen(batch)).float()
        sums = ((planes - target).abs().sum(dim=1) * inside).sum(dim=(1, 2))
        return (sums / (3 * inside.sum(dim=(1, 2)).clamp(min=1))).mean()


def _cross_entropy(logits: Float[Tensor, "b s s"], truth: Tensor) -> Float[Tensor, ""]:
    return functional.binary_cross_entropy_with_logits(logits, truth.float())


def _seen(batch: Batch) -> Tensor:
    assert batch.seen is not None, "check_plan has made sure of it"
    return batch.seen
