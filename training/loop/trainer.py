"""Shards and a recipe in, a checkpoint out.

``train`` is the whole: it resumes, takes the steps, and leaves checkpoints and the state to go on from.
"""

import itertools
import math
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import final

import torch

from pix2face.errors import Pix2FaceError
from pix2face.inference import CHECKPOINT_NAME
from training.data.batches import TrainingBatch
from training.data.shard_index import ShardIndex
from training.loop.loss_log import LossLog, StepReport
from training.loop.resume import load_state, save_state, steps_done
from training.loop.tasks import MapTask, Surroundings, Task, check_plan
from training.loop.validation import Scores, Validator
from training.recipe.recipe import Recipe

RESUME_NAME = "resume.safetensors"
LOG_NAME = "log.jsonl"
BEST_NAME = "best.safetensors"


@final
class TrainingStopped(Pix2FaceError):  # noqa: N818 (nothing went wrong)
    """A training was asked to stop, and left the state to go on from."""


@final
@dataclass(frozen=True, kw_only=True)
class Observers:
    """Who is told of a training, and who can end it. All do nothing unless told otherwise.

    Attributes:
        on_step: Is told of every step.
        on_scores: Is told of every validation: samples seen, scores, and the validator with the network.
        should_stop: Asked after every step; once it says yes, the state is written and the training ends.
    """

    on_step: Callable[[StepReport], None] = lambda report: None
    on_scores: Callable[[int, Scores, torch.nn.Module], None] = lambda samples, scores, network: None
    should_stop: Callable[[], bool] = lambda: False


def train(
    shards: ShardIndex,
    recipe: Recipe,
    out: Path,
    surroundings: Surroundings,
    *,
    initial: Path | None = None,
    validator: Validator | None = None,
    observers: Observers | None = None,
) -> Path:
    """Trains until the recipe is done, from where an earlier call with the same arguments was interrupted.

    Args:
        shards: The samples.
        recipe: What to do.
        out: Folder of the checkpoint, the state to resume from, and the log.
        surroundings: Where to do it.
        initial: A checkpoint whose weights, and scales, are started from.
        validator: Measures the network as often as it wants; None does without.
        observers: Who is told.

    Returns:
        The checkpoint.

    Raises:
        UsageError: ``out`` holds a training with another configuration, or two arguments do not go together.
        InputFileError: A shard, the initial checkpoint or the state to resume from cannot be read.
        Pix2FaceError: The loss is not finite any more.
        TrainingStopped: It was asked to stop.
    """
    recipe.check()
    check_plan(shards, recipe, surroundings.processes)
    return train_task(MapTask(shards, recipe, initial), out, surroundings, validator, observers)


def train_task(
    task: Task,
    out: Path,
    surroundings: Surroundings,
    validator: Validator | None = None,
    observers: Observers | None = None,
) -> Path:
    """As ``train``, for any task."""
    _Training(task, out, surroundings).run(validator, observers or Observers())
    return out / CHECKPOINT_NAME


@final
class _Training:
    """One training on its way."""

    def __init__(self, task: Task, out: Path, surroundings: Surroundings) -> None:
        self._task, self._out, self._surroundings = task, out, surroundings
        self._recipe = task.recipe
        self._is_first = surroundings.processes.is_first
        self._learner = task.new_learner(surroundings)
        self._best, self._waited_seconds = math.inf, 0.0
        if steps_done(out / RESUME_NAME, task.configuration):
            self._best = load_state(out / RESUME_NAME, self._learner)
        elif task.initial is not None:
            self._learner.start_from(task.initial)
        surroundings.processes.wait_for_all()  # else the first may write what others still read
        self._log = LossLog(out / LOG_NAME, self._samples) if self._is_first else None
        self._state_written = time.monotonic()

    @property
    def _samples(self) -> int:
        return self._learner.steps_done * self._recipe.batch_size

    def run(self, validator: Validator | None, observers: Observers) -> None:
        """Takes all steps that are left."""
        recipe, loader = self._recipe, self._task.new_loader(self._surroundings)
        n_left = recipe.steps - self._learner.steps_done
        # Those beyond the last step are for the norms.
        n_beyond = recipe.norm_batches if n_left and self._learner.has_batch_norms else 0
        with closing(loader.batches(self._samples, n_left + n_beyond)) as batches:
            for batch in itertools.islice(batches, n_left):
                report = self._step(batch, loader.wait_seconds)
                observers.on_step(report)
                if n_beyond and self._learner.steps_done == recipe.steps:
                    self._learner.measure_norms(batches)
                self._record(report, validator, observers)
        self._surroundings.processes.wait_for_all()

    def _record(self, report: StepReport, validator: Validator | None, observers: Observers) -> None:
        """Validates, writes and stops where that is due after a step."""
        is_end = report.step == self._recipe.epoch_steps
        if self._log:
            if is_end:
                self._log.flush()
            if validator and validator.is_due(report.samples, report.images, is_end=is_end):
                self._validate(validator, report, observers)
        if is_end or time.monotonic() - self._state_written >= 60 * self._surroundings.state_minutes:
            self._save()
        if self._is_asked_to_stop(observers):
            self._save()
            self._surroundings.processes.wait_for_all()
            raise TrainingStopped(f"stopped after {report.samples} samples; the same command goes on from there")

    def _step(self, batch: TrainingBatch, waited_seconds: float) -> StepReport:
        epoch, step = divmod(self._learner.steps_done, self._recipe.epoch_steps)
        losses = self._learner.step(batch)
        waited, self._waited_seconds = waited_seconds - self._waited_seconds, waited_seconds
        report = StepReport(
            epoch=epoch,
            step=step + 1,
            samples=self._samples,
            images=self._recipe.batch_size,
            loss=losses.total,
            parts=losses.parts,
            learning_rate=losses.learning_rate,
            waited_seconds=waited,
        )
        if self._log:
            self._log.add(report)
        return report

    def _validate(self, validator: Validator, report: StepReport, observers: Observers) -> None:
        scores = validator.scores(self._learner.result)
        assert self._log is not None
        self._log.validation(report.epoch, report.samples, scores.as_numbers())
        observers.on_scores(report.samples, scores, self._learner.result)
        if scores.error < self._best:
            self._best = scores.error
            self._save_checkpoint(BEST_NAME)

    def _save(self) -> None:
        """Writes the checkpoint, then the state that goes on from it."""
        if self._is_first:
            self._save_checkpoint(CHECKPOINT_NAME)
            save_state(self._out / RESUME_NAME, self._learner, self._task.configuration, self._best)
        self._state_written = time.monotonic()

    def _save_checkpoint(self, name: str) -> None:
        self._learner.check_weights()
        epochs = self._learner.steps_done // self._recipe.epoch_steps
        self._task.save(self._out / name, self._learner.result, epochs, self._samples)

    def _is_asked_to_stop(self, observers: Observers) -> bool:
        """Whether one of all processes is."""
        asked = torch.tensor(float(observers.should_stop()), device=self._surroundings.device)
        return self._surroundings.processes.mean(asked).item() > 0
