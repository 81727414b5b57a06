"""The recipe: all numbers of a training. torch is loaded on first use, so that help is quick."""

import math
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal, final

import tyro

from pix2face.errors import UsageError
from pix2face.geometry.crops import INFERENCE_SCALE, LARGEST_CROP_SCALE, SMALLEST_CROP_SCALE
from pix2face.geometry.jitter import JitterRange
from pix2face.networks import MAP_PLANES, MOST_PLANES, ArchitectureName
from pix2face.networks.dimensions import ARCHITECTURES, LARGEST_SIDE_PX, MOST_FILTERS
from training.recipe.schedule import ScheduleName

if TYPE_CHECKING:
    import torch

Precision = Literal["float32", "bfloat16"]
LossOver = Literal["all", "mask", "seen"]
Cropping = Literal["full", "box", "shift", "none"]

LARGEST_SEED = 2**63 - 1


@final
@dataclass(frozen=True, kw_only=True)
class LossWeights:
    """How much each part counts in the loss, a weighted mean. The paper weighs both maps alike.

    Attributes:
        pncc: Weight of the mean absolute error of PNCC, in units of its scale.
        offset: Weight of the mean absolute error of the offsets, in units of their scale.
        linear: Weight of the linear part of both errors within each face: what a wrong camera would explain of them.
        mask: Weight of the cross entropy of the mask, if the network predicts it.
        seen: Weight of the cross entropy of the visible part of the mask, if the network predicts it.
        scale: Weight of the likelihood of the errors of PNCC, if the network predicts their scale. It changes nothing
            but the scale.
        landmarks: Weight of the likelihood of the landmarks, if the network predicts them.
    """

    pncc: Annotated[float, tyro.conf.arg(name="weight-pncc")] = 1.0
    offset: Annotated[float, tyro.conf.arg(name="weight-offset")] = 1.0
    linear: Annotated[float, tyro.conf.arg(name="weight-linear")] = 0.0
    mask: Annotated[float, tyro.conf.arg(name="weight-mask")] = 1.0
    seen: Annotated[float, tyro.conf.arg(name="weight-seen")] = 1.0
    scale: Annotated[float, tyro.conf.arg(name="weight-scale")] = 0.02
    landmarks: Annotated[float, tyro.conf.arg(name="weight-landmarks")] = 0.02


class StepRecipe:
    """The numbers that the trainer itself goes by, whatever it trains; ``Recipe`` explains them."""

    batch_size: int
    parts: int = 1
    epochs: int
    epoch_size: int
    learning_rate: float
    schedule: ScheduleName
    warm_up: int
    precision: Precision
    clip: float
    ema: float
    norm_batches: int
    seed: int

    @property
    def epoch_steps(self) -> int:
        """Steps an epoch: its pictures in whole batches, rounded up."""
        return math.ceil(self.epoch_size / self.batch_size)

    @property
    def steps(self) -> int:
        """Steps of the whole training."""
        return self.epochs * self.epoch_steps

    def check(self) -> None:
        """Makes sure that the numbers make sense.

        Raises:
            UsageError: One does not.
        """
        for name in ("batch_size", "parts", "epochs", "epoch_size", "learning_rate"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise UsageError(f"{_option(name)}: expected a finite number above 0, found {value}")
        for name in ("warm_up", "clip", "norm_batches"):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise UsageError(f"{_option(name)}: expected a finite number of at least 0, found {value}")
        if not 0 <= self.ema < 1:
            raise UsageError(f"--ema: expected 0 or more and less than 1, found {self.ema}")
        if not 0 <= self.seed <= LARGEST_SEED:
            raise UsageError(f"--seed: expected 0 to {LARGEST_SEED}, found {self.seed}")
        if self.batch_size % self.parts:
            raise UsageError(f"--parts: expected a divisor of {self.batch_size}, the batch's size, found {self.parts}")


@final
@dataclass(frozen=True, kw_only=True)
class Recipe(StepRecipe):
    """Everything that the trained weights depend on, apart from the data.

    Attributes:
        architecture: Architecture of the network.
        size_px: Side of the network's input: a power of two (paper) or a multiple of 64 (residual).
        filters: Filters of the network's first level.
        planes: Output planes: 6 for PNCC and offset, 7 with the mask, 8 also with its visible part (the shards must
            have the layer `seen`), 9 also with the scale of the errors of PNCC.
        n_landmarks: 68 for a network that also predicts the landmarks of the shards and the scales of their errors.
        batch_size: Number of pictures per step, for all parts and processes together.
        parts: Compute each batch in this many parts, one after the other, and add their gradients; this saves memory.
        epochs: Number of epochs, of --epoch-size pictures each. A checkpoint is written after each epoch.
        epoch_size: Number of pictures per epoch, drawn from the shards repeatedly with new jitter; rounded up to whole
            batches.
        learning_rate: Largest learning rate of Adam.
        schedule: How the learning rate falls. paper: after each epoch, to 0.021 of its start. cosine, linear: after
            each step, to 0.
        warm_up: Number of pictures over which the learning rate first rises from 0 (cosine, linear).
        precision: Arithmetic of the network's layers; weights and loss are always float32. A CPU that has no
            instructions for bfloat16 computes in float32.
        weights: Weights of the parts of the loss.
        loss_over: Pixels over which the errors of the maps are averaged: all pixels, the mask, or its visible part.
        clip: Largest norm of the gradient; larger gradients are scaled down to it. 0 for no limit.
        ema: Decay per step of the running mean of the weights, which the checkpoint then contains; 0 for no running
            mean.
        norm_batches: Number of batches over which the statistics of batch norms are measured again after the last step,
            with the weights of the checkpoint; 0 keeps the running statistics. Source: Izmailov et al. 2018, Sec. 3.2.
        seed: Seed of the initial weights, the order of the samples and their jitter.
        jitter: How far samples are varied.
        cropping: full: crops are turned, scaled and shifted, as in the paper. box: squares of --crop-scale around the
            face's box, shifted by a few per cent, as at inference; much faster. shift: squares of whole pixels at
            random places, for pictures that were rendered as crops; as fast as box. none: the middle of the picture,
            with unchanged colours.
        crop_scale: Side of the crop that the network gets at inference, in units of the longer side of the face's box;
            stored in the checkpoint.
    """

    architecture: ArchitectureName = "paper"
    size_px: int
    filters: int
    planes: int = MAP_PLANES
    n_landmarks: Literal[0, 68] = 0
    batch_size: int
    parts: int = 1
    epochs: int
    epoch_size: int
    learning_rate: float
    schedule: ScheduleName = "paper"
    warm_up: int = 0
    precision: Precision
    weights: Annotated[LossWeights, tyro.conf.arg(name=""), tyro.conf.OmitArgPrefixes] = field(
        default_factory=LossWeights
    )
    loss_over: LossOver = "all"
    clip: float = 0.0
    ema: float = 0.0
    norm_batches: int = 0
    seed: int = 0
    jitter: tyro.conf.Suppress[JitterRange] = field(default_factory=JitterRange)
    cropping: Cropping = "full"
    crop_scale: float = INFERENCE_SCALE

    @property
    def widths(self) -> tuple[int, ...]:
        """Filters of each level of the network."""
        return ARCHITECTURES[self.architecture].widths(self.size_px, self.filters)

    def new_network(self) -> "torch.nn.Module":
        """A network with random weights."""
        from pix2face.networks.architectures import build_network

        return build_network(self.architecture, self.size_px, self.widths, self.planes, self.n_landmarks)

    def check(self) -> None:
        """Makes sure that the numbers make sense.

        Raises:
            UsageError: One does not.
        """
        super().check()
        if self.filters < 1:
            raise UsageError(f"--filters: expected more than 0, found {self.filters}")
        if not SMALLEST_CROP_SCALE <= self.crop_scale <= LARGEST_CROP_SCALE:
            raise UsageError(
                f"--crop-scale: expected {SMALLEST_CROP_SCALE:g} to {LARGEST_CROP_SCALE:g}, found {self.crop_scale}"
            )
        self._check_network()
        self._check_loss()

    def _check_network(self) -> None:
        for name, largest in (("size_px", LARGEST_SIDE_PX), ("planes", MOST_PLANES)):
            if getattr(self, name) > largest:
                raise UsageError(f"{_option(name)}: expected at most {largest}, found {getattr(self, name)}")
        if self.planes < MAP_PLANES:
            raise UsageError(f"--planes: expected at least {MAP_PLANES}, found {self.planes}")
        try:
            widest = max(self.widths)
        except ValueError as error:
            raise UsageError(f"--size-px: {error}") from error
        if widest > MOST_FILTERS:
            raise UsageError(
                f"--filters: expected at most {MOST_FILTERS * self.filters // widest}, so that no level has "
                f"more than {MOST_FILTERS}, found {self.filters}"
            )

    def _check_loss(self) -> None:
        for name, weight in asdict(self.weights).items():
            if not 0 <= weight < math.inf:
                raise UsageError(f"--weight-{name}: expected 0 or more, found {weight}")
        if not self.weights.pncc + self.weights.offset > 0:
            raise UsageError("--weight-pncc, --weight-offset: expected one above 0, found none")
        if self.loss_over != "all" and self.planes == MAP_PLANES:
            raise UsageError(
                f"--loss-over {self.loss_over}: expected --planes 7 or 8, found {MAP_PLANES}: a network that learns "
                "nothing of the background must be told by a mask where the face is"
            )


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
