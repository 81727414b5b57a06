"""The loss: a weighted mean of named parts."""

from dataclasses import asdict, dataclass
from typing import final

import torch
from jaxtyping import Float, Int16
from torch import Tensor
from torch.nn import functional

from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from pix2face.networks import MAP_PLANES, MASK_PLANE, SCALE_PLANE, SEEN_PLANE
from training.data.batches import Batch
from training.recipe.recipe import LossOver, LossWeights

# What a network with landmarks answers, or one without.
Answer = Tensor | tuple[Tensor, Tensor]
# A thousandth of the side, or of the scale of PNCC: less would let single samples rule a step.
SMALLEST_LOG_SCALE = -7.0
# The linear part of errors is measured at every second pixel of every second row.
LINEAR_STEP = 2
# Keeps linear functions determined where a mask is empty or nearly flat.
SMALLEST_EIGENVALUE = 1e-4


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

    def parts(self, answer: Answer, batch: Batch) -> dict[str, Float[Tensor, ""]]:
        """The parts of the loss by name, unweighted. The batch must know ``seen`` where the loss needs it.

        The answer is a network's: its planes, or these and its landmarks.
        """
        planes, landmarks = (answer, None) if isinstance(answer, Tensor) else answer
        planes = planes.float()
        errors = self._errors(planes[:, :3], batch.pncc, self.pncc_scale_mm)
        offset_errors = self._errors(planes[:, 3:MAP_PLANES], batch.offset, self.offset_scale_mm)
        parts = {"pncc": self._mean(errors, batch), "offset": self._mean(offset_errors, batch)}
        if self.weights.linear:
            parts["linear"] = self._linear_errors(planes[:, :MAP_PLANES], batch)
        if planes.shape[1] > MASK_PLANE:
            parts["mask"] = _cross_entropy(planes[:, MASK_PLANE], batch.mask)
        if planes.shape[1] > SEEN_PLANE:
            parts["seen"] = _cross_entropy(planes[:, SEEN_PLANE], _seen(batch))
        if planes.shape[1] > SCALE_PLANE:
            log_scale = planes[:, SCALE_PLANE].clamp(min=SMALLEST_LOG_SCALE)
            # Only the scale learns from its likelihood: the maps learn from all pixels alike.
            parts["scale"] = self._mean(errors.detach() * torch.exp(-log_scale) + log_scale, batch)
        if landmarks is not None:
            parts["landmarks"] = _landmark_likelihood(landmarks.float(), batch)
        return parts

    def total(self, parts: dict[str, Float[Tensor, ""]]) -> Float[Tensor, ""]:
        """The weighted mean of the parts. With equal weights, and maps alone, the mean over all six planes.

        Source: Crispell and Bazik 2017, Sec. 3.1 (L1 over both maps).
        """
        weights = asdict(self.weights)
        weighted = torch.stack([weights[name] * part for name, part in parts.items()])
        return weighted.sum() / sum(weights[name] for name in parts)

    def _errors(
        self, planes: Float[Tensor, "b 3 s s"], steps: Int16[Tensor, "b 3 s s"], scale_mm: float
    ) -> Float[Tensor, "b s s"]:
        """The mean absolute error of each pixel."""
        # One pass changes type and memory layout; in two layouts the comparison would take twice as long.
        target = torch.empty_like(planes).copy_(steps).mul_(1 / (FIXED_POINT_STEPS_PER_MM * scale_mm))
        return (planes - target).abs().mean(dim=1)

    def _linear_errors(self, planes: Float[Tensor, "b 6 s s"], batch: Batch) -> Float[Tensor, ""]:
        """The mean absolute value of the linear part of the errors of points on the mean face and on this face.

        Within each face, the errors over the mask are approximated by a linear function of the true PNCC. Such errors
        turn, move and scale the fitted camera, while errors that change within a face cancel out in it. The mean
        absolute error hardly sees a small linear part below larger other errors.
        """
        every = (slice(None), slice(None), slice(None, None, LINEAR_STEP), slice(None, None, LINEAR_STEP))
        pncc, offset = (
            steps[every].float().flatten(2) / (FIXED_POINT_STEPS_PER_MM * self.pncc_scale_mm)
            for steps in (batch.pncc, batch.offset)
        )
        found = planes[every].flatten(2)
        errors = found[:, :3] - pncc
        offset_errors = found[:, 3:] * (self.offset_scale_mm / self.pncc_scale_mm) - offset
        errors = torch.cat((errors, errors + offset_errors), dim=1)
        inside = batch.mask[:, None][every].float().flatten(2)
        weights = inside / inside.sum(dim=2, keepdim=True).clamp(min=1)
        terms = torch.cat((torch.ones_like(pncc[:, :1]), pncc), dim=1)
        gram = (terms * weights) @ terms.mT + SMALLEST_EIGENVALUE * torch.eye(4, device=terms.device)
        linear = torch.linalg.solve(gram, (terms * weights) @ errors.mT).mT @ terms
        return (linear.abs() * weights).sum(dim=2).mean()

    def _mean(self, values: Float[Tensor, "b s s"], batch: Batch) -> Float[Tensor, ""]:
        if self.over == "all":  # the background counts and should be 0
            return values.mean()
        inside = (batch.mask if self.over == "mask" else _seen(batch)).float()
        return ((values * inside).sum(dim=(1, 2)) / inside.sum(dim=(1, 2)).clamp(min=1)).mean()


def _landmark_likelihood(landmarks: Float[Tensor, "b n 3"], batch: Batch) -> Float[Tensor, ""]:
    """The negative logarithm of the likelihood of the true places, up to a constant, if errors fall off like exp(-r).

    Deviation from the source: whose errors are normal. Landmarks behind hair and hands have longer tails.

    Source: Wood et al. 2022, 3D Face Reconstruction with Dense Landmarks, Eq. 1.
    """
    log_scale = landmarks[:, :, 2].clamp(min=SMALLEST_LOG_SCALE)
    distance = (landmarks[:, :, :2] - (batch.landmarks2d / batch.image.shape[-1] - 0.5)).norm(dim=2)
    return (distance * torch.exp(-log_scale) + 2 * log_scale).mean()


def _cross_entropy(logits: Float[Tensor, "b s s"], truth: Tensor) -> Float[Tensor, ""]:
    return functional.binary_cross_entropy_with_logits(logits, truth.float())


def _seen(batch: Batch) -> Tensor:
    assert batch.seen is not None, "check_plan has made sure of it"
    return batch.seen
