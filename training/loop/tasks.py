"""What can be trained: a task brings a network, batches, losses and checkpoints; the trainer does the rest."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from torch import nn

from pix2face.errors import UsageError
from pix2face.inference.torch_networks import load_checkpoint, save_checkpoint
from pix2face.networks import SEEN_PLANE
from pix2face.networks.residual import ResidualUNet
from training.data.batches import Draws
from training.data.dataset import DrawDataset
from training.data.loader import DrawLoader
from training.data.shard_index import ShardIndex
from training.loop.learner import ALONE, Learner, Losses
from training.loop.losses import LossPlan
from training.loop.processes import Processes
from training.loop.run_configuration import checkpoint_header, training_configuration, with_scales_of
from training.recipe.recipe import Recipe, StepRecipe


@final
@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What a training runs on. It changes the speed, not the plan.

    Attributes:
        device: Name of a torch device.
        workers: Processes that decode and jitter samples; 0 does it between steps.
        cache_bytes: Memory for decoded samples, over all workers together.
        is_compiled: Whether torch.compile makes the passes through the network faster.
        state_minutes: The state to go on from is written so often, beside the ends of epochs.
        processes: All that share the work.
    """

    device: str
    workers: int
    cache_bytes: int
    is_compiled: bool = False
    state_minutes: float = 10.0
    processes: Processes = ALONE


class Task(ABC):
    """What the trainer trains.

    Attributes:
        recipe: How long and how fast.
        configuration: Everything that the weights depend on, as JSON.
        initial: A network whose weights are started from, if there is one.
    """

    recipe: StepRecipe
    configuration: str
    initial: nn.Module | None

    @abstractmethod
    def new_network(self) -> nn.Module:
        """A network with new weights, drawn from torch's generator."""

    @abstractmethod
    def losses(self) -> Losses:
        """What is minimised."""

    @abstractmethod
    def draws(self, cache_bytes: int) -> Draws[Any]:
        """Where batches come from; decoded samples take at most ``cache_bytes``."""

    @abstractmethod
    def save(self, path: Path, network: nn.Module, epochs: int, samples: int) -> None:
        """Writes a checkpoint of a network that has seen some samples in some complete epochs."""

    def new_learner(self, surroundings: Surroundings) -> Learner:
        """The network before its first step."""
        where = surroundings.device, surroundings.processes, surroundings.is_compiled
        return Learner(self.recipe, self.new_network, self.losses(), *where)

    def new_loader(self, surroundings: Surroundings) -> DrawLoader[Any]:
        """What brings the batches."""
        return DrawLoader(
            self.draws(surroundings.cache_bytes),
            self.recipe.batch_size,
            workers=surroundings.workers,
            pin_memory=surroundings.device.startswith("cuda"),
            rank=surroundings.processes.rank,
            n_ranks=surroundings.processes.count,
        )


@final
class MapTask(Task):
    """Maps of faces from crops of shards, from the weights and scales of the checkpoint ``initial`` if there is one."""

    recipe: Recipe

    def __init__(self, shards: ShardIndex, recipe: Recipe, initial: Path | None = None) -> None:
        start = load_checkpoint(initial) if initial else None
        if start and isinstance(start[1], ResidualUNet):
            start[1].correction = None  # it is of the fits to maps that this training changes
        self.recipe, self.initial = recipe, start[1] if start else None
        self._shards = with_scales_of(start[0], shards, recipe) if start else shards
        self.configuration = training_configuration(self._shards, recipe, initial)

    def new_network(self) -> nn.Module:
        """A network with random weights."""
        return self.recipe.new_network()

    def losses(self) -> LossPlan:
        """The losses of the maps, and of what else the network answers."""
        return LossPlan(
            pncc_scale_mm=self._shards.pncc_scale_mm,
            offset_scale_mm=self._shards.offset_scale_mm,
            weights=self.recipe.weights,
            over=self.recipe.loss_over,
        )

    def draws(self, cache_bytes: int) -> DrawDataset:
        """Crops of samples."""
        return DrawDataset(self._shards, self.recipe, cache_bytes)

    def save(self, path: Path, network: nn.Module, epochs: int, samples: int) -> None:
        """Writes a checkpoint."""
        header = checkpoint_header(self._shards, self.recipe, self.configuration, epochs, samples)
        save_checkpoint(path, header, network)


def check_landmarks(shards: ShardIndex, count: int, option: str, advice: str) -> None:
    """Makes sure that the samples have as many landmarks as a network predicts, if it predicts any.

    Raises:
        UsageError: They do not. The message names the option and ends with the advice.
    """
    counts = {reader.column("landmarks2d").shape[1] for reader in shards.readers}
    if count and counts != {count}:
        found = ", ".join(str(own) for own in sorted(counts))
        raise UsageError(f"{option}: expected shards with {count} landmarks a sample, found {found}; {advice}")


def check_plan(shards: ShardIndex, recipe: Recipe, processes: Processes) -> None:
    """Makes sure that the samples know what is to be learned, and that batches can be divided.

    Raises:
        UsageError: They do not, or they cannot.
    """
    if (recipe.planes > SEEN_PLANE or recipe.loss_over == "seen") and not shards.knows_seen:
        raise UsageError(
            "--planes 8, --loss-over seen: expected shards with the layer seen, found some without it; render "
            "synthetic photographs, or train with --planes 7 (or 6) and --loss-over all (or mask)"
        )
    check_landmarks(shards, recipe.n_landmarks, "--n-landmarks", "give 0")
    shares = processes.count * recipe.parts
    if recipe.batch_size % shares:
        raise UsageError(
            f"--batch-size: expected a multiple of {shares} ({processes.count} processes, {recipe.parts} parts), "
            f"found {recipe.batch_size}"
        )
