"""Shows a training on the command line, as a progress bar, and in TensorBoard."""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, final

import torch
from jaxtyping import Float32
from torch import Tensor, nn

from pix2face.errors import UsageError
from pix2face.files.writing import naming_failed_writes
from pix2face.networks import MAP_PLANES, MASK_PLANE
from training.data.batches import as_input, target_planes
from training.loop.loss_log import STEPS_A_LINE, StepReport
from training.loop.trainer import Observers
from training.loop.validation import Scores, Validator

# Weight of the last step in the smoothed loss behind the bar.
SMOOTHING = 0.05
# Faces in TensorBoard's pictures.
N_FACES = 8


class RunLog(ABC):
    """What shows the curves of a training: losses every 50 steps, and the scores of each validation."""

    def step(self, report: StepReport) -> None:
        """Takes a step; every 50th is logged."""
        if report.step % STEPS_A_LINE == 0:
            losses = {f"loss/{name}": value for name, value in {"total": report.loss, **report.parts}.items()}
            self.log({**losses, "learning rate": report.learning_rate}, report.samples)

    def scores(self, samples: int, scores: Scores, network: nn.Module) -> None:
        """Takes the scores of a validation, and the network that has them."""
        self.log({f"validation/{name}": value for name, value in scores.as_numbers().items()}, samples)

    @abstractmethod
    def log(self, values: Mapping[str, float], samples: int) -> None:
        """Logs values by name, after ``samples`` samples."""

    @abstractmethod
    def close(self) -> None:
        """Writes the rest."""


@contextmanager
def observers_of(
    advance: Callable[..., None],
    n_epochs: int,
    should_stop: Callable[[], bool],
    logs: Sequence[RunLog] = (),
) -> Iterator[Observers]:
    """The observers of a training: a progress bar, which ``advance`` moves, and logs, which are closed at the end."""
    progress = _Progress(advance, n_epochs)

    def on_step(report: StepReport) -> None:
        progress.step(report)
        for log in logs:
            log.step(report)

    def on_scores(samples: int, scores: Scores, network: nn.Module) -> None:
        progress.score(scores)
        for log in logs:
            log.scores(samples, scores, network)

    try:
        yield Observers(on_step=on_step, on_scores=on_scores, should_stop=should_stop)
    finally:
        with ExitStack() as closing:  # all of them, whichever fails
            for log in logs:
                closing.callback(log.close)


@final
class _Progress:
    """The note behind the bar: loss, validation error, share of the time spent waiting for data."""

    def __init__(self, advance: Callable[..., None], n_epochs: int) -> None:
        self._advance, self._n_epochs = advance, n_epochs
        self._loss: float | None = None
        self._error = ""
        self._began, self._waited = time.monotonic(), 0.0

    def step(self, report: StepReport) -> None:
        self._loss = report.loss if self._loss is None else self._loss + SMOOTHING * (report.loss - self._loss)
        self._waited += report.waited_seconds
        waiting = self._waited / max(time.monotonic() - self._began, 1e-9)
        note = f"epoch {report.epoch + 1}/{self._n_epochs}  loss {self._loss:.4f}{self._error}  wait {waiting:.0%}"
        self._advance(report.images, note=note)

    def score(self, scores: Scores) -> None:
        found = f"{scores.pncc_mm:.1f} mm" if scores.nme is None else f"{scores.nme:.2%}"
        self._error = f"  val {found}"


@final
class TensorboardLog(RunLog):
    """Writes curves, and at each validation pictures of faces of the validator.

    Raises:
        UsageError: TensorBoard is not installed.
    """

    def __init__(self, folder: Path, validator: Validator | None) -> None:
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError as error:
            raise UsageError(
                "expected the package tensorboard, which --tensorboard needs; run: pip install 'pix2face[tensorboard]'"
            ) from error
        self._folder, self._validator = folder, validator
        self._hook = threading.excepthook
        threading.excepthook = self._say_later
        with naming_failed_writes(folder):
            self._writer: Any = SummaryWriter(str(folder))

    def scores(self, samples: int, scores: Scores, network: nn.Module) -> None:
        """Writes the scores of a validation, and pictures by the network."""
        super().scores(samples, scores, network)
        with naming_failed_writes(self._folder):
            if self._validator:
                pictures = prediction_pictures(network, self._validator)
                self._writer.add_image("picture, PNCC, truth, offset, truth, mask", pictures, samples)
            self._writer.flush()

    def log(self, values: Mapping[str, float], samples: int) -> None:
        """Writes values."""
        with naming_failed_writes(self._folder):
            for name, value in values.items():
                self._writer.add_scalar(name, value, samples)

    def close(self) -> None:
        """Writes the rest."""
        try:
            with naming_failed_writes(self._folder):
                self._writer.close()
        finally:
            threading.excepthook = self._hook

    def _say_later(self, failure: threading.ExceptHookArgs) -> None:
        """Lets TensorBoard's thread fail to write without a traceback: the next call raises the same error."""
        if not issubclass(failure.exc_type, OSError):
            self._hook(failure)


def prediction_pictures(network: nn.Module, validator: Validator) -> Float32[Tensor, "3 h w"]:
    """A row for each face: the picture, PNCC and its truth, offset and its truth, and the mask.

    x, y, z are red, green, blue, from minus one scale to one; grey is 0.
    """
    batch = validator.first_batch()[:N_FACES]
    device = next(network.parameters()).device
    was_training = network.training
    network.eval()
    with torch.inference_mode():
        planes = network(as_input(batch.image.to(device))).float().cpu()
    network.train(was_training)
    truth = target_planes(batch, *validator.scales_mm)
    has_mask = planes.shape[1] > MASK_PLANE
    mask = planes[:, MASK_PLANE].sigmoid() if has_mask else planes[:, :3].norm(dim=1).clamp(max=1)
    columns = [
        batch.image / 255,
        *(_coloured(maps[:, first : first + 3]) for first in range(0, MAP_PLANES, 3) for maps in (planes, truth)),
        mask[:, None].expand(-1, 3, -1, -1),
    ]
    return torch.cat([torch.cat(list(column), dim=1) for column in columns], dim=2)


def _coloured(maps: Float32[Tensor, "b 3 s s"]) -> Float32[Tensor, "b 3 s s"]:
    return (maps / 2 + 0.5).clamp(0, 1)
