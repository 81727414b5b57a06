"""Curves of a training in Weights & Biases or trackio, which have the same functions."""

import importlib
import json
from collections.abc import Mapping
from typing import Any, final

from pix2face.errors import UsageError
from training.loop.observers import RunLog
from training.train_config import TrackerName

PROJECT = "pix2face"


@final
class TrackerLog(RunLog):
    """Logs curves by the number of pictures.

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

    def log(self, values: Mapping[str, float], samples: int) -> None:
        """Logs values."""
        self._package.log(dict(values), step=samples)

    def close(self) -> None:
        """Ends the run."""
        self._package.finish()
