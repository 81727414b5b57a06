"""The command ``train detector``: people and pictures without people in, a detector of faces out."""

from collections.abc import Sequence
from contextlib import ExitStack

from rich.console import Console

from pix2face.command_line import counted, prepare_output_folder, progress_bar, say
from pix2face.errors import UsageError
from pix2face.stop_signals import exit_status_of, first_signal
from training.data.shard_folders import parse_shard_folders
from training.data.shard_index import index_shards
from training.detection.detector_task import DetectorTask
from training.detection.people import PEOPLE_LAYERS
from training.loop.observers import observers_of
from training.loop.resume import steps_done
from training.loop.tasks import Surroundings
from training.loop.trainer import RESUME_NAME, TrainingStopped, train_task
from training.train_config import DetectorConfig


def detector(config: DetectorConfig) -> int:
    """Runs ``train detector``."""
    console = Console(stderr=True)
    if config.workers < 0 or config.state_minutes < 0:
        raise UsageError(
            f"expected --workers and --state-minutes of at least 0, found {config.workers} and {config.state_minutes}"
        )
    shards = index_shards(parse_shard_folders(config.shards), layers=PEOPLE_LAYERS)
    task = DetectorTask(shards, config.backgrounds, config.things, config.numbers, config.init)
    prepare_output_folder(config.out)
    done = steps_done(config.out / RESUME_NAME, task.configuration) * config.numbers.batch_size
    say(console, f"people: {shards.description}; scenes: {counted(config.numbers.steps, 'step')}, {done} scenes done")
    surroundings = Surroundings(
        device=config.device, workers=config.workers, cache_bytes=0, state_minutes=config.state_minutes
    )
    with ExitStack() as stack:
        signals: list[int] = []
        stack.enter_context(first_signal(signals.append))
        advance = stack.enter_context(
            progress_bar(console, "training", config.numbers.steps * config.numbers.batch_size)
        )
        advance(done, already_done=True)
        watching = observers_of(advance, config.numbers.epochs, lambda: bool(signals))
        try:
            path = train_task(task, config.out, surroundings, observers=stack.enter_context(watching))
        except TrainingStopped as stopped:
            say(console, str(stopped))
            return exit_of(signals)
    say(console, f"detector: {path}")
    return 0


def exit_of(signals: Sequence[int]) -> int:
    """The exit status of a training that was asked to stop."""
    return exit_status_of(signals[0])
