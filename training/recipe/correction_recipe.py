"""The recipe of the correction of fits: all numbers of its training. torch is loaded on first use."""

from dataclasses import dataclass
from typing import final

import tyro

from training.recipe.recipe import StepRecipe
from training.recipe.schedule import ScheduleName


@final
@dataclass(frozen=True, kw_only=True)
class CorrectionRecipe(StepRecipe):
    """Everything that the weights of the correction depend on, apart from the network and the data.

    Attributes:
        batch_size: Number of fits per step.
        epochs: Number of epochs. A checkpoint is written after each.
        epoch_size: Number of fits per epoch, of crops that are drawn from the shards repeatedly with new jitter.
        learning_rate: Largest learning rate of Adam.
        schedule: How the learning rate falls, as for `train`.
        warm_up: Number of fits over which the learning rate first rises from 0.
        clip: Largest norm of the gradient; larger gradients are scaled down to it. 0 for no limit.
        ema: Decay per step of the running mean of the weights. The checkpoint contains this mean; 0 for no running
            mean.
        seed: Seed of the initial weights, the order of the samples and their jitter.
        frozen: Train the correction alone; the network does not change. By default, both learn.
    """

    batch_size: int = 24
    epochs: int = 12
    epoch_size: int = 6_000
    learning_rate: float = 1e-4
    schedule: ScheduleName = "cosine"
    warm_up: int = 2_400
    clip: float = 1.0
    ema: float = 0.998
    seed: int = 0
    frozen: tyro.conf.FlagCreatePairsOff[bool] = False

    precision = "float32"  # the fit needs the digits
    norm_batches = 0  # norms keep their running statistics
