"""The log of a training: JSON lines, one for every 50 steps, with averages over them, and one for each validation."""

import json
import resource
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from pix2face.files.writing import naming_failed_writes, write_file

STEPS_A_LINE = 50


@final
@dataclass(frozen=True, kw_only=True)
class StepReport:
    """One step of training."""

    epoch: int  # from 0
    step: int  # within the epoch, from 1
    samples: int  # since the training began, with those of this step
    images: int  # in the batch of this step
    loss: float  # what is minimised
    parts: Mapping[str, float]  # unweighted, by name
    learning_rate: float
    waited_seconds: float  # for the batch


@final
class LossLog:
    """Appends to a JSON-lines file.

    Lines of more than ``samples`` samples, which an interrupted training has left, are dropped.
    """

    def __init__(self, path: Path, samples: int) -> None:
        self._path = path
        self._pending: list[StepReport] = []
        self._since = time.monotonic()
        path.parent.mkdir(parents=True, exist_ok=True)
        kept = _lines_until(path, samples) if samples and path.is_file() else []
        write_file(path, "".join(kept))

    def add(self, report: StepReport) -> None:
        """Takes a step; every 50th writes a line."""
        self._pending.append(report)
        if len(self._pending) >= STEPS_A_LINE:
            self.flush()

    def flush(self) -> None:
        """Writes the steps since the last line, if any; called at the end of an epoch, so that no line spans two."""
        if not self._pending:
            return
        last, now = self._pending[-1], time.monotonic()
        seconds = max(now - self._since, 1e-9)
        images = sum(report.images for report in self._pending)
        line: dict[str, Any] = {"epoch": last.epoch, "step": last.step, "samples": last.samples}
        line["loss"] = round(sum(report.loss * report.images for report in self._pending) / images, 6)
        for name in last.parts:
            line[name] = round(sum(report.parts[name] * report.images for report in self._pending) / images, 6)
        line["learning_rate"] = last.learning_rate
        line["images_per_second"] = round(images / seconds, 1)
        line["waiting"] = round(sum(report.waited_seconds for report in self._pending) / seconds, 4)
        line["memory_mb"] = round(memory_mb())
        self._write(line)
        self._pending, self._since = [], now

    def validation(self, epoch: int, samples: int, scores: Mapping[str, float]) -> None:
        """Writes the scores of a validation. The time that it took does not count for the rate."""
        rounded = {name: round(value, 5) for name, value in scores.items()}
        self._write({"epoch": epoch, "samples": samples, "validation": rounded})
        self._since = time.monotonic()

    def _write(self, line: Mapping[str, Any]) -> None:
        with naming_failed_writes(self._path), self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")


def memory_mb() -> float:
    """The most memory that this process has had at a time, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def _lines_until(path: Path, samples: int) -> list[str]:
    """Complete lines of no more samples; a half line, from a crash while writing, goes."""
    kept = []
    for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
        try:
            if json.loads(line)["samples"] <= samples:
                kept.append(line)
        except (ValueError, KeyError, TypeError):
            continue
    return kept
