"""The command ``train``: shards to a checkpoint."""

import math
import os
from contextlib import ExitStack
from pathlib import Path

import torch
from rich.console import Console
from rich.panel import Panel

from pix2face.command_line import progress_bar, say
from pix2face.errors import Pix2FaceError, UsageError
from pix2face.files.writing import write_file
from pix2face.inference.checkpoint import load_header
from pix2face.models.morphable_model import builtin_model
from pix2face.stop_signals import collected_signals
from training.data.shard_folders import parse_shard_folders
from training.data.shard_index import ShardIndex, index_shards, split_off
from training.loop.observers import RunLog, TensorboardLog, observers_of
from training.loop.plan_report import dry_run, summary
from training.loop.processes import Processes, device_of_process, joined_processes
from training.loop.resume import steps_done
from training.loop.run_configuration import training_configuration, with_scales_of
from training.loop.tasks import Surroundings
from training.loop.tracker_log import TrackerLog
from training.loop.trainer import RESUME_NAME, TrainingStopped, train
from training.loop.validation import Validator, validator_of
from training.recipe.recipe import Recipe
from training.task_run import exit_of, prepare_training_folder
from training.train_config import CONFIGURATION_NAME, TrainConfig


def train_network(config: TrainConfig) -> int:
    """Trains, and shows a summary first, then a progress bar, and at the end the next command."""
    recipe = config.recipe()
    with ExitStack() as stack:
        signals = stack.enter_context(collected_signals())
        processes = stack.enter_context(joined_processes(checked_device(config)))
        surroundings = surroundings_of(config, processes)
        _limit_threads(surroundings)
        console = Console(stderr=True, quiet=not processes.is_first)
        shards, validator = _data(config, recipe)
        if config.dry_run:
            for line in dry_run(shards, recipe, surroundings):
                say(console, line)
            return 0
        out = config.out
        prepare_training_folder(out, config.restart and processes.is_first)
        processes.wait_for_all()
        done = steps_done(out / RESUME_NAME, training_configuration(shards, recipe, config.init)) * recipe.batch_size
        if processes.is_first:
            write_file(out / CONFIGURATION_NAME, config.as_json())
        panel = summary(shards, recipe, config.preset, surroundings.device, out, done)
        console.print(Panel(panel, title="train", expand=False))
        advance = stack.enter_context(progress_bar(console, "training", recipe.steps * recipe.batch_size))
        advance(done, already_done=True)
        logs: list[RunLog] = [TensorboardLog(out / "tensorboard", validator)] if config.tensorboard else []
        if config.tracker and processes.is_first:
            logs.append(TrackerLog(config.tracker, out.name, config.as_json()))
        watching = observers_of(advance, recipe.epochs, lambda: bool(signals), logs)
        observers = stack.enter_context(watching)
        try:
            checkpoint = train(
                shards, recipe, out, surroundings, initial=config.init, validator=validator, observers=observers
            )
        except TrainingStopped as stopped:
            say(console, str(stopped))
            return exit_of(signals)
        except RuntimeError as error:  # torch has no narrower one for a partner that is gone
            if processes.count == 1:
                raise
            raise Pix2FaceError(
                f"process {processes.rank} of {processes.count}: {str(error).splitlines()[0]}. "
                "Did another process end? The same command goes on from the last state"
            ) from error
    say(console, f"checkpoint: {checkpoint}")
    say(console, f"next: {next_command(shards, checkpoint)}")
    return 0


def next_command(shards: ShardIndex, checkpoint: Path) -> str:
    """The next command for a checkpoint. It names a benchmark only after training on renders of the built-in model."""
    builtin = builtin_model()
    # Renders are under the terms of their model and nothing else; photographs have terms of their own.
    if (shards.model_sha256, shards.licence) == (builtin.sha256, builtin.licence):
        return f"evaluate --split builtin-heldout --data HELDOUT --checkpoint {checkpoint} (says how to make HELDOUT)"
    return f"evaluate --help lists the benchmarks for --checkpoint {checkpoint}"


def surroundings_of(config: TrainConfig, processes: Processes) -> Surroundings:
    """The machine that the options ask for.

    Raises:
        UsageError: A number makes no sense.
    """
    for name, least in (("cache_gb", 0.0), ("workers", 0), ("state_minutes", 0.0)):
        value = getattr(config, name)
        if value is not None and not least <= value < math.inf:
            unit = " (in 10^9 bytes)" if name == "cache_gb" else ""
            raise UsageError(f"--{name.replace('_', '-')}: expected 0 or more{unit}, found {value}")
    default_workers = min(max(cores() // 2, 1), 8)
    return Surroundings(
        device=checked_device(config),
        workers=default_workers if config.workers is None else config.workers,
        cache_bytes=int(config.cache_gb * 1e9),
        is_compiled=config.compile,
        state_minutes=config.state_minutes,
        processes=processes,
    )


def checked_device(config: TrainConfig) -> str:
    """The device of this process.

    Raises:
        UsageError: The machine has no such device.
    """
    device = device_of_process(config.device or ("cuda" if torch.cuda.is_available() else "cpu"))
    try:
        torch.zeros(1, device=device).item()  # some devices only pretend to hold numbers
    except (RuntimeError, AssertionError, ImportError) as error:
        raise UsageError(
            f"--device {device}: {str(error).splitlines()[0]}; leave it out to take what is there"
        ) from error
    return device


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def _data(config: TrainConfig, recipe: Recipe) -> tuple[ShardIndex, Validator | None]:
    """The samples to train on, and the validator for the others."""
    if not 0 <= config.validation < 1:
        raise UsageError(f"--validation: expected a share from 0 to less than 1, found {config.validation}")
    if not config.shards:
        raise UsageError("--shards: expected folders of shards, found none")
    shards = index_shards(parse_shard_folders(config.shards), config.where)
    if recipe.jitter.mirror and shards.mirror_obstacle:
        raise UsageError(
            f"--mirror yes: expected shards whose samples can be mirrored, but {shards.mirror_obstacle}; "
            "give --mirror no"
        )
    if config.init:
        shards = with_scales_of(load_header(config.init), shards, recipe)
    if not config.validation:
        return shards, None
    shards, held_out = split_off(shards, config.validation)
    return shards, validator_of(held_out, recipe, config.validation_samples, config.validate_every)


def _limit_threads(surroundings: Surroundings) -> None:
    """Leaves the workers their cores: with more threads than cores, parallel sections wait for each other."""
    if "OMP_NUM_THREADS" not in os.environ:
        torch.set_num_threads(max(cores() - surroundings.workers, 1))
