"""The program ``train``: shards to a checkpoint."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, final

import torch
import tyro
from rich.console import Console
from rich.panel import Panel
from rich.text import Text

from pix2face.command_line import counted, prepare_output_folder, printable, progress_bar, run_commands, say
from pix2face.errors import UsageError
from pix2face.morphable_model import builtin_model
from pix2face.runs import CHECKPOINT_NAME, RUNS
from training.loss_log import StepReport
from training.presets import PRESETS, Precision, PresetName, Recipe
from training.resume import epochs_done
from training.shard_index import ShardIndex, index_shards
from training.speed import duration_in_words, seconds_per_image
from training.trainer import LOG_NAME, RESUME_NAME, Surroundings, train, training_configuration

DESCRIPTION = """Trains the network on shards that `datagen render` wrote.

Run the same command again to go on after an interruption: it starts from the last complete epoch and ends exactly
where it would have ended without one."""

_OVERRIDABLE = ("epochs", "epoch_size", "batch_size", "size_px", "filters", "learning_rate", "precision", "seed")


@final
@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """The command line; None takes the preset's value.

    Attributes:
        shards: Folders of shards, all of one morphable model.
        out: Folder of the checkpoint, the log and the state to resume from; default runs/PRESET.
        preset: paper: 256 px, 64 filters, 60 epochs of 100,000 pictures; asks for a GPU. tiny: two minutes, two cores.
        epochs: Passes with a learning rate of their own; a checkpoint is written after each. Where this is not given,
            nor one of those down to --precision, nor --seed, the preset's value holds.
        epoch_size: Pictures an epoch, drawn over and over with ever new jitter.
        batch_size: Pictures a step.
        size_px: Side of the network's input, a power of two.
        filters: Filters of the network's first level.
        learning_rate: Adam's in the first epoch; it falls to 0.021 of that.
        precision: Arithmetic of the network's layers.
        mirror: Mirror every other sample. The paper does not; refused where the model is not symmetric.
        seed: Of the first weights, the order of the samples and their jitter.
        restart: Replace what the output folder holds of an earlier training.
        workers: Processes that load samples; None takes one for each second core, at most 8.
        cache_gb: Memory for decoded samples, over all workers.
        device: cpu, cuda, cuda:1, ...; None takes a GPU where there is one.
    """

    shards: tuple[Path, ...]
    out: Path | None = None
    preset: PresetName = "paper"
    epochs: int | None = None
    epoch_size: int | None = None
    batch_size: int | None = None
    size_px: int | None = None
    filters: int | None = None
    learning_rate: float | None = None
    precision: Precision | None = None
    mirror: bool = False
    seed: int | None = None
    restart: bool = False
    workers: int | None = None
    cache_gb: float = 1.0
    device: str | None = None

    def recipe(self) -> Recipe:
        """The preset with what was given in its place.

        Raises:
            UsageError: A number makes no sense.
        """
        given: dict[str, Any] = {name: getattr(self, name) for name in _OVERRIDABLE}
        recipe = replace(PRESETS[self.preset], **{name: value for name, value in given.items() if value is not None})
        if self.mirror:
            recipe = replace(recipe, jitter=replace(recipe.jitter, mirror=True))
        recipe.check()
        return recipe

    def surroundings(self) -> Surroundings:
        """The machine.

        Raises:
            UsageError: It has no such device.
        """
        if not 0 <= self.cache_gb < float("inf"):
            raise UsageError(f"--cache-gb: expected 0 or more (in 10^9 bytes), found {self.cache_gb}")
        if (self.workers or 0) < 0:
            raise UsageError(f"--workers: expected 0 or more, found {self.workers}")
        default_workers = min(max(_cores() // 2, 1), 8)
        device = self.device or ("cuda" if torch.cuda.is_available() else "cpu")
        try:
            torch.zeros(1, device=device).item()  # some devices only pretend to hold numbers
        except (RuntimeError, AssertionError, ImportError) as error:
            raise UsageError(
                f"--device {device}: {str(error).splitlines()[0]}; leave it out to take what is there"
            ) from error
        return Surroundings(
            device=device,
            workers=default_workers if self.workers is None else self.workers,
            cache_bytes=int(self.cache_gb * 1e9),
        )


def run(config: Annotated[TrainConfig, tyro.conf.arg(name="")]) -> int:
    """Trains, with a summary before, a progress bar meanwhile and the next command afterwards."""
    console = Console(stderr=True)
    recipe, surroundings = config.recipe(), config.surroundings()
    if "OMP_NUM_THREADS" not in os.environ:
        # More threads than cores make every parallel section wait for the one that is not running.
        torch.set_num_threads(max(_cores() - surroundings.workers, 1))
    out = config.out or RUNS / config.preset
    shards = index_shards(config.shards)
    if recipe.jitter.mirror and shards.mirror_obstacle:
        raise UsageError(f"--mirror: expected shards whose samples can be mirrored, but {shards.mirror_obstacle}")
    prepare_output_folder(out)
    if config.restart:
        for name in (CHECKPOINT_NAME, RESUME_NAME, LOG_NAME):
            (out / name).unlink(missing_ok=True)
    done = epochs_done(out / RESUME_NAME, training_configuration(shards, recipe))
    summary = Text(_summary(config, recipe, shards, surroundings, out, done))
    console.print(Panel(summary, title="train", expand=False))
    with progress_bar(console, "training", recipe.epochs * recipe.epoch_size) as advance:
        advance(done * recipe.epoch_size)

        def show(step: StepReport) -> None:
            note = f"epoch {step.epoch + 1}/{recipe.epochs}  loss {step.loss:.4f}"
            advance(step.images, note=note)

        checkpoint = train(shards, recipe, out, surroundings, on_step=show)
    say(console, f"checkpoint: {checkpoint}")
    say(console, f"next: {next_command(shards, checkpoint)}")
    return 0


def next_command(shards: ShardIndex, checkpoint: Path) -> str:
    """What to do with a checkpoint. Which benchmark suits it is known for renders of the built-in model alone."""
    builtin = builtin_model()
    # Renders are under the terms of their model and nothing else; photographs have terms of their own.
    if (shards.model_sha256, shards.licence) == (builtin.sha256, builtin.licence):
        return f"evaluate --split builtin-heldout --data HELDOUT --checkpoint {checkpoint} (says how to make HELDOUT)"
    return f"evaluate --help lists the benchmarks for --checkpoint {checkpoint}"


def main(argv: Sequence[str] | None = None) -> int:
    """Runs ``train``; returns the exit status."""
    return run_commands("train", DESCRIPTION, {"": run}, argv)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _summary(
    config: TrainConfig, recipe: Recipe, shards: ShardIndex, surroundings: Surroundings, out: Path, done: int
) -> str:
    images = (recipe.epochs - done) * recipe.epoch_size
    seconds = images * seconds_per_image(recipe, surroundings.device) if images else 0.0
    lines = {
        "samples": f"{len(shards)} in {counted(len(shards.paths), 'shard')}",
        "model": f"{shards.model_name} ({shards.model_sha256[:12]})",
        "terms": shards.licence,
        "scales": f"PNCC {shards.pncc_scale_mm:.0f} mm, offset {shards.offset_scale_mm:.0f} mm",
        "preset": f"{config.preset}: {recipe.size_px} px, {counted(recipe.filters, 'filter')}, "
        f"batches of {recipe.batch_size}, {recipe.precision}",
        "plan": f"{counted(recipe.epochs, 'epoch')} of {counted(recipe.epoch_size, 'picture')}"
        + (f", {done} done" if done else ""),
        "takes": f"about {duration_in_words(seconds)} on {surroundings.device}, if loading keeps up",
        "writes": str(out / CHECKPOINT_NAME),
    }
    return "\n".join(f"{name:<8} {printable(text)}" for name, text in lines.items())
