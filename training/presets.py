"""What a training does, number by number, and the two named sets of numbers.

``paper`` is the paper's: 256 px, 64 filters, batches of 4, 60 epochs of 100,000 pictures. It asks for a GPU and days.

``tiny`` shows on two CPU cores, in about two minutes, that everything works. It is the same architecture, loss,
optimiser, jitter and schedule. It differs in size (64 px, so two levels less, and 16 filters), in the number of
pictures, in larger batches (fewer, cheaper steps) and in bfloat16 arithmetic. In equal time 64 px come out well ahead
of 128 px, because so short a training is limited by the number of pictures seen (docs/training.md).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, final

from pix2face.errors import UsageError
from pix2face.jitter import JitterRange
from pix2face.networks.paper import level_count

Precision = Literal["float32", "bfloat16"]
PresetName = Literal["paper", "tiny"]

# Eight times the paper's side and sixteen times its filters: beyond that no machine holds the network.
LARGEST_SIZE_PX, MOST_FILTERS = 2048, 1024
LARGEST_SEED = 2**63 - 1


@final
@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Everything that the trained weights depend on, apart from the data.

    Attributes:
        size_px: Side of the network's input, a power of two.
        filters: Filters of its first level.
        batch_size: Pictures a step.
        epochs: Epochs; the learning rate changes between them, and a checkpoint is written after each.
        epoch_size: Pictures an epoch, drawn from the shards over and over with ever new jitter.
        learning_rate: Adam's, in the first epoch.
        precision: Arithmetic of the network's layers; weights and loss are float32 in any case.
        seed: Of the initial weights, the order of the samples and the jitter.
        jitter: How far samples are varied.
    """

    size_px: int
    filters: int
    batch_size: int
    epochs: int
    epoch_size: int
    learning_rate: float
    precision: Precision
    seed: int = 0
    jitter: JitterRange = field(default_factory=JitterRange)

    def check(self) -> None:
        """Makes sure that the numbers make sense.

        Raises:
            UsageError: One does not.
        """
        for name in ("filters", "batch_size", "epochs", "epoch_size", "learning_rate"):
            if not getattr(self, name) > 0:
                raise UsageError(f"--{name.replace('_', '-')}: expected more than 0, found {getattr(self, name)}")
        if not 0 <= self.seed <= LARGEST_SEED:
            raise UsageError(f"--seed: expected 0 to {LARGEST_SEED}, found {self.seed}")
        for name, largest in (("size_px", LARGEST_SIZE_PX), ("filters", MOST_FILTERS)):
            if getattr(self, name) > largest:
                raise UsageError(f"--{name.replace('_', '-')}: expected at most {largest}, found {getattr(self, name)}")
        try:
            level_count(self.size_px)
        except ValueError as error:
            raise UsageError(f"--size-px: {error}") from error


PRESETS: Mapping[PresetName, Recipe] = MappingProxyType(
    {
        # Source: Crispell and Bazik 2017, Sec. 3.2.
        "paper": Recipe(
            size_px=256,
            filters=64,
            batch_size=4,
            epochs=60,
            epoch_size=100_000,
            learning_rate=1e-3,
            precision="float32",
        ),
        "tiny": Recipe(
            size_px=64,
            filters=16,
            batch_size=8,
            epochs=6,
            epoch_size=3_000,
            learning_rate=1e-3,
            precision="bfloat16",
        ),
    }
)
