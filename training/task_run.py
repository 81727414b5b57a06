"""Runs a task that has a recipe of its own, with a progress bar: what `train detector` and `train correction` share."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from signal import SIGTERM

from rich.console import Console

from pix2face.command_line import counted, prepare_output_folder, progress_bar, say
from pix2face.errors import UsageError
from pix2face.inference import CHECKPOINT_NAME
from pix2face.stop_signals import collected_signals, exit_status_of
from training.loop.observers import observers_of
from training.loop.processes import device_of_process, joined_processes
from training.loop.resume import steps_done
from training.loop.tasks import Surroundings, Task
from training.loop.trainer import BEST_NAME, LOG_NAME, RESUME_NAME, TrainingStopped, train_task
from training.train_config import CorrectionConfig, DetectorConfig


def run_task(task: Task, what: str, data: str, config: DetectorConfig | CorrectionConfig) -> int:
    """Trains in a folder, from where an earlier call was interrupted, and returns the exit status.

    Args:
        task: What to train.
        what: What it learns from, as messages call it: "scene", for example.
        data: What there is of it, for the user.
        config: The folder, and where to do it.

    Raises:
        UsageError: A number of the configuration makes no sense, or its folder holds another training.
    """
    if config.workers < 0 or config.state_minutes < 0:
        raise UsageError(
            f"expected --workers and --state-minutes of at least 0, found {config.workers} and {config.state_minutes}"
        )
    recipe, out, device = task.recipe, config.out, device_of_process(config.device)
    with ExitStack() as stack:
        signals = stack.enter_context(collected_signals())
        processes = stack.enter_context(joined_processes(device))
        surroundings = Surroundings(
            device=device,
            workers=config.workers,
            cache_bytes=0,
            state_minutes=config.state_minutes,
            processes=processes,
        )
        console = Console(stderr=True, quiet=not processes.is_first)
        prepare_training_folder(out, config.restart and processes.is_first)
        processes.wait_for_all()
        say(console, data)
        done = steps_done(out / RESUME_NAME, task.configuration) * recipe.batch_size
        say(console, f"{counted(recipe.steps, 'step')}, {counted(done, what)} done")
        advance = stack.enter_context(progress_bar(console, "training", recipe.steps * recipe.batch_size))
        advance(done, already_done=True)
        watching = observers_of(advance, recipe.epochs, lambda: bool(signals))
        try:
            path = train_task(task, out, surroundings, observers=stack.enter_context(watching))
        except TrainingStopped as stopped:
            say(console, str(stopped))
            return exit_of(signals)
        say(console, str(path))
    return 0


def prepare_training_folder(out: Path, is_restarted: bool) -> None:
    """Makes the folder of a training, and removes what an earlier one has left, if asked to."""
    prepare_output_folder(out)
    if is_restarted:
        for name in (CHECKPOINT_NAME, BEST_NAME, RESUME_NAME, LOG_NAME):
            (out / name).unlink(missing_ok=True)


def exit_of(signals: Sequence[int]) -> int:
    """The exit status of a training of which this process, or another one, was asked to stop."""
    return exit_status_of(signals[0] if signals else SIGTERM)
