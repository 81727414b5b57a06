"""What can be trained: a task brings a network, batches, losses and checkpoints; the trainer does the rest."""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, final, runtime_checkable

from torch import nn

from pix2face.errors import UsageError
from pix2face.inference.torch_networks import load_checkpoint, save_checkpoint
from pix2face.networks import SEEN_PLANE
from pix2face.networks.residual import ResidualUNet
from training.data.loader import BatchLoader, DrawLoader
from training.data.loading_processes import B, Draws
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


@runtime_checkable
class Loader(Protocol):
    """Brings the batches of a training, and says how long callers have waited for them."""

    wait_seconds: float

    def batches(self, first_draw: int, n_batches: int) -> Generator[Any, None, None]:
        """Some batches, from a draw on."""


@runtime_checkable
class Task(Protocol):
    """What the trainer trains."""

    recipe: StepRecipe  # how long and how fast
    configuration: str  # everything that the weights depend on, as JSON
    initial: nn.Module | None  # a network whose weights are started from

    def new_learner(self, surroundings: Surroundings) -> Learner:
        """The network before its first step."""

    def new_loader(self, surroundings: Surroundings) -> Loader:
        """What brings the batches."""

    def save(self, path: Path, network: nn.Module, epochs: int, samples: int) -> None:
        """Writes a checkpoint of a network that has seen some samples in some complete epochs."""


@final
class MapTask:
    """Maps of faces from crops of shards, from the weights and scales of the checkpoint ``initial`` if there is one."""

    def __init__(self, shards: ShardIndex, recipe: Recipe, initial: Path | None = None) -> None:
        start = load_checkpoint(initial) if initial else None
        if start and isinstance(start[1], ResidualUNet):
            start[1].correction = None  # it is of the fits to maps that this training changes
        self.recipe: StepRecipe = recipe
        self.initial = start[1] if start else None
        self._own_recipe = recipe
        self._shards = with_scales_of(start[0], shards, recipe) if start else shards
        self.configuration = training_configuration(self._shards, recipe, initial)

    def new_learner(self, surroundings: Surroundings) -> Learner:
        """The network before its first step."""
        return new_learner(self._shards, self._own_recipe, surroundings)

    def new_loader(self, surroundings: Surroundings) -> Loader:
        """What brings the batches."""
        return new_loader(self._shards, self._own_recipe, surroundings)

    def save(self, path: Path, network: nn.Module, epochs: int, samples: int) -> None:
        """Writes a checkpoint."""
        header = checkpoint_header(self._shards, self._own_recipe, self.configuration, epochs, samples)
        save_checkpoint(path, header, network)


def new_learner(shards: ShardIndex, recipe: Recipe, surroundings: Surroundings) -> Learner:
    """The network before its first step."""
    plan = LossPlan(
        pncc_scale_mm=shards.pncc_scale_mm,
        offset_scale_mm=shards.offset_scale_mm,
        weights=recipe.weights,
        over=recipe.loss_over,
    )
    return learner_on(surroundings, recipe, recipe.new_network, plan)


def learner_on(
    surroundings: Surroundings, recipe: StepRecipe, new_network: Callable[[], nn.Module], losses: Losses
) -> Learner:
    """A network before its first step, where it is trained."""
    return Learner(recipe, new_network, losses, surroundings.device, surroundings.processes, surroundings.is_compiled)


def new_loader(shards: ShardIndex, recipe: Recipe, surroundings: Surroundings) -> BatchLoader:
    """What brings the batches."""
    return BatchLoader(
        shards,
        recipe,
        workers=surroundings.workers,
        cache_bytes=surroundings.cache_bytes,
        pin_memory=surroundings.device.startswith("cuda"),
        rank=surroundings.processes.rank,
        n_ranks=surroundings.processes.count,
    )


def draw_loader(draws: Draws[B], batch_size: int, surroundings: Surroundings) -> DrawLoader[B]:
    """What brings batches of the draws of a task."""
    return DrawLoader(
        draws,
        batch_size,
        workers=surroundings.workers,
        pin_memory=surroundings.device.startswith("cuda"),
        rank=surroundings.processes.rank,
        n_ranks=surroundings.processes.count,
    )


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
