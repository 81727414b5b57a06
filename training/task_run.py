"""Runs a task that has a recipe of its own, with a progress bar: what `train detector` and `train correction` share."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from signal import SIGTERM

from rich.console import Console

from pix2face.command_line import counted, prepare_output_folder, progress_bar, say
from pix2face.errors import UsageError
from pix2face.stop_signals import exit_status_of, first_signal
from training.loop.observers import observers_of
from training.loop.processes import joined_processes
from training.loop.resume import steps_done
from training.loop.tasks import Surroundings, Task
from training.loop.trainer import RESUME_NAME, TrainingStopped, train_task


def run_task(task: Task, what: str, out: Path, surroundings: Surroundings) -> int:
    """Trains in a folder, from where an earlier call was interrupted, and returns the exit status.

    Args:
        task: What to train.
        what: What it learns from, as messages call it: "scene", for example.
        out: Folder of the checkpoint, the log and the state to resume from.
        surroundings: Where to do it.

    Raises:
        UsageError: A number of the surroundings makes no sense, or ``out`` holds another training.
    """
    if surroundings.workers < 0 or surroundings.state_minutes < 0:
        raise UsageError(
            "expected --workers and --state-minutes of at least 0, found "
            f"{surroundings.workers} and {surroundings.state_minutes}"
        )
    with ExitStack() as stack:
        signals: list[int] = []
        stack.enter_context(first_signal(signals.append))
        processes = stack.enter_context(joined_processes(surroundings.device))
        surroundings = replace(surroundings, processes=processes)
        console, recipe = Console(stderr=True, quiet=not processes.is_first), task.recipe
        prepare_output_folder(out)
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


def exit_of(signals: Sequence[int]) -> int:
    """The exit status of a training of which this process, or another one, was asked to stop."""
    return exit_status_of(signals[0] if signals else SIGTERM)
