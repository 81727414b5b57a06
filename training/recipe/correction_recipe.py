"""The recipe of the correction of fits: all numbers of its training. torch is loaded on first use."""

import math
from dataclasses import asdict, dataclass
from typing import final

import tyro

from pix2face.errors import UsageError
from training.recipe.recipe import Epochs, Precision
from training.recipe.schedule import ScheduleName


@final
@dataclass(frozen=True, kw_only=True)
class CorrectionRecipe(Epochs):
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

    @property
    def parts(self) -> int:
        """Batches are computed whole."""
        return 1

    @property
    def precision(self) -> Precision:
        """The fit needs the digits."""
        return "float32"

    @property
    def norm_batches(self) -> int:
        """Norms keep their running statistics."""
        return 0

    def check(self) -> None:
        """Makes sure that the numbers make sense.

        Raises:
            UsageError: One does not.
        """
        for name, value in asdict(self).items():
            least = 1 if name in ("batch_size", "epochs", "epoch_size") else 0
            if isinstance(value, int | float) and not least <= value < math.inf:
                raise UsageError(f"--{name.replace('_', '-')}: expected {least} or more, found {value}")
        if not self.ema < 1:
            raise UsageError(f"--ema: expected less than 1, found {self.ema}")
