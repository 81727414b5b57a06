"""Who watches a training from the command line: the progress bar, TensorBoard, the signals."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import final

from torch import nn

from training.loop.loss_log import StepReport
from training.loop.stop_request import StopRequest
from training.loop.tensorboard_log import TensorboardLog
from training.loop.trainer import Observers
from training.loop.validator import Scores, Validator
from training.recipe.recipe import Recipe
from training.train_config import TrainConfig

# Of the past that the numbers behind the bar speak of, the last step counts so much.
SMOOTHING = 0.05


@contextmanager
def observers_of(
    config: TrainConfig,
    recipe: Recipe,
    out: Path,
    advance: Callable[..., None],
    request: StopRequest,
    validator: Validator | None,
) -> Iterator[Observers]:
    """Puts together who watches.

    Args:
        config: Says whether TensorBoard does.
        recipe: What is done.
        out: Where TensorBoard's files go.
        advance: Of the progress bar.
        request: Ends the training.
        validator: Has pictures to show.

    Raises:
        UsageError: TensorBoard is asked for and not installed.
    """
    board = TensorboardLog(out / "tensorboard", validator) if config.tensorboard else None
    progress = _Progress(advance, recipe)

    def on_step(report: StepReport) -> None:
        progress.step(report)
        if board:
            board.step(report)

    def on_scores(samples: int, scores: Scores, network: nn.Module) -> None:
        progress.score(scores)
        if board:
            board.scores(samples, scores, network)

    try:
        yield Observers(on_step=on_step, on_scores=on_scores, should_stop=request.is_made)
    finally:
        if board:
            board.close()


@final
class _Progress:
    """The note behind the bar: loss, validation error, share of the time spent waiting for data."""

    def __init__(self, advance: Callable[..., None], recipe: Recipe) -> None:
        self._advance, self._recipe = advance, recipe
        self._loss: float | None = None
        self._error = ""
        self._clock = _WaitShare()

    def step(self, report: StepReport) -> None:
        self._loss = report.loss if self._loss is None else self._loss + SMOOTHING * (report.loss - self._loss)
        waiting = self._clock.share(report.waited_seconds)
        note = f"epoch {report.epoch + 1}/{self._recipe.epochs}  loss {self._loss:.4f}{self._error}  wait {waiting:.0%}"
        self._advance(report.images, note=note)

    def score(self, scores: Scores) -> None:
        found = f"{scores.pncc_mm:.1f} mm" if scores.nme is None else f"{scores.nme:.2%}"
        self._error = f"  val {found}"


@final
class _WaitShare:
    """What part of the time between steps was spent waiting for data."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._waited = 0.0

    def share(self, waited_seconds: float) -> float:
        """The share since the first step, this one's wait included."""
        self._waited += waited_seconds
        return self._waited / max(time.monotonic() - self._began, 1e-9)
