"""The recipe of the detector: all numbers of its training."""

import math
from dataclasses import dataclass
from typing import final

from pix2face.errors import UsageError
from pix2face.networks.dimensions import CENTRE_MULTIPLE
from training.recipe.recipe import Precision, StepRecipe
from training.recipe.schedule import ScheduleName


@final
@dataclass(frozen=True, kw_only=True)
class DetectorRecipe(StepRecipe):
    """Everything that the detector's weights depend on, apart from the data.

    Attributes:
        size_px: Side of the scenes, a multiple of 32.
        batch_size: Number of scenes per step.
        epochs: Number of epochs. A checkpoint is written after each.
        epoch_size: Number of scenes per epoch. Every scene is new.
        learning_rate: Largest learning rate of Adam.
        schedule: How the learning rate falls, as for `train`.
        warm_up: Number of scenes over which the learning rate first rises from 0.
        precision: Arithmetic of the network's layers; weights and loss are always float32.
        box_weight: Weight of the loss of the boxes, relative to that of the heatmap of centres.
        clip: Largest norm of the gradient; 0 for no limit.
        ema: Decay per step of the running mean of the weights. The checkpoint contains this mean; 0 for no running
            mean.
        norm_batches: Number of batches over which the batch norms are measured again after the last step.
        seed: Seed of the initial weights and of the scenes.
    """

    size_px: int = 256
    batch_size: int = 32
    epochs: int = 20
    epoch_size: int = 20_000
    learning_rate: float = 2e-3
    schedule: ScheduleName = "cosine"
    warm_up: int = 6_400
    precision: Precision = "bfloat16"
    box_weight: float = 0.5
    clip: float = 10.0
    ema: float = 0.998
    norm_batches: int = 100
    seed: int = 0

    def check(self) -> None:
        """Makes sure that the numbers make sense.

        Raises:
            UsageError: One does not.
        """
        super().check()
        if self.size_px < 1 or self.size_px % CENTRE_MULTIPLE:
            raise UsageError(f"--size-px: expected a multiple of {CENTRE_MULTIPLE}, found {self.size_px}")
        if not 0 <= self.box_weight < math.inf:
            raise UsageError(f"--box-weight: expected 0 or more, found {self.box_weight}")
