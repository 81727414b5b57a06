"""Curves of a training in Weights & Biases or trackio, which have the same functions."""

import importlib
import json
from typing import Any, final

from torch import nn

from pix2face.errors import UsageError
from training.loop.loss_log import STEPS_A_LINE, StepReport
from training.loop.validation import Scores
from training.train_config import TrackerName

PROJECT = "pix2face"


@final
class TrackerLog:
    """Logs losses every 50 steps, and the scores of each validation, by the number of pictures.

    Args:
        package: Which of the two.
        name: Of the run.
        configuration: Options of the training, as JSON.

    Raises:
        UsageError: The package is not installed.
    """

    def __init__(self, package: TrackerName, name: str, configuration: str) -> None:
        try:
            self._package: Any = importlib.import_module(package)
        except ImportError as error:
            raise UsageError(
                f"expected the package {package}, which --tracker {package} needs; run: pip install {package}"
            ) from error
        self._package.init(project=PROJECT, name=name, config=json.loads(configuration))

    def step(self, report: StepReport) -> None:
        """Takes a step; every 50th is logged."""
        if report.step % STEPS_A_LINE == 0:
            losses = {f"loss/{name}": value for name, value in {"total": report.loss, **report.parts}.items()}
            self._package.log({**losses, "learning rate": report.learning_rate}, step=report.samples)

    def scores(self, samples: int, scores: Scores, network: nn.Module) -> None:
        """Logs the scores of a validation."""
        del network  # as ``RunLog`` has it
        named = {f"validation/{name}": value for name, value in scores.as_numbers().items()}
        self._package.log(named, step=samples)

    def close(self) -> None:
        """Ends the run."""
        self._package.finish()
