"""What the training minimises: named parts, each with a weight of its own."""

from dataclasses import asdict, dataclass
from typing import Literal, final

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from pix2face.networks.architectures import MASK_PLANE, SEEN_PLANE
from pix2face.networks.paper import MAP_PLANES
from training.batches import Batch, target_planes

LossOver = Literal["all", "mask", "seen"]


@final
@dataclass(frozen=True, kw_only=True)
class LossWeights:
    """How much each part counts in the mean that is minimised; equal ones for the maps are the paper's.

    Attributes:
        pncc: Mean absolute error of PNCC, in units of its scale.
        offset: The same of offsets.
        mask: Cross entropy of the mask, where the network has a plane for it.
        seen: Cross entropy of its seen part, where the network has a plane for it.
    """

    pncc: float = 1.0
    offset: float = 1.0
    mask: float = 1.0
    seen: float = 1.0


@final
@dataclass(frozen=True, kw_only=True)
class LossPlan:
    """What to compare, and how.

    Attributes:
        pncc_scale_mm: The network's first three planes are PNCC divided by this.
        offset_scale_mm: The next three are offsets divided by this.
        weights: Of the parts.
        over: Pixels over which maps are compared. In each picture the mean over these, so that every picture counts
            the same, and a batch is the mean of its parts.
    """

    pncc_scale_mm: float
    offset_scale_mm: float
    weights: LossWeights
    over: LossOver

    def parts(self, planes: Float[Tensor, "b planes s s"], batch: Batch) -> dict[str, Float[Tensor, ""]]:
        """Each part of the loss by its name, unweighted.

        Args:
            planes: The network's answer.
            batch: The truth, on the same device; with ``seen`` where the loss asks for it.
        """
        target = target_planes(batch, self.pncc_scale_mm, self.offset_scale_mm)
        errors = (planes[:, :MAP_PLANES] - target).abs()
        parts = {"pncc": self._mean(errors[:, :3], batch), "offset": self._mean(errors[:, 3:], batch)}
        if planes.shape[1] > MASK_PLANE:
            parts["mask"] = _cross_entropy(planes[:, MASK_PLANE], batch.mask)
        if planes.shape[1] > SEEN_PLANE:
            parts["seen"] = _cross_entropy(planes[:, SEEN_PLANE], _seen(batch))
        return parts

    def total(self, parts: dict[str, Float[Tensor, ""]]) -> Float[Tensor, ""]:
        """The weighted mean of the parts. With equal weights, and maps alone, the mean over all six planes.

        Source: Crispell and Bazik 2017, Sec. 3.1 (L1 over both maps).
        """
        weights = asdict(self.weights)
        weighted = torch.stack([weights[name] * part for name, part in parts.items()])
        return weighted.sum() / sum(weights[name] for name in parts)

    def _mean(self, errors: Float[Tensor, "b 3 s s"], batch: Batch) -> Float[Tensor, ""]:
        if self.over == "all":  # the background counts and should be 0
            return errors.mean()
        inside = (batch.mask if self.over == "mask" else _seen(batch)).float()
        sums = (errors.sum(dim=1) * inside).sum(dim=(1, 2))
        return (sums / (3 * inside.sum(dim=(1, 2)).clamp(min=1))).mean()


def _cross_entropy(logits: Float[Tensor, "b s s"], truth: Tensor) -> Float[Tensor, ""]:
    return functional.binary_cross_entropy_with_logits(logits, truth.float())


def _seen(batch: Batch) -> Tensor:
    assert batch.seen is not None, "the trainer has looked whether the shards know it"
    return batch.seen
