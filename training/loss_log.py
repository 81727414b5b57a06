"""The record of a training: one JSON object a line, averaged over some steps each."""

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import final

STEPS_A_LINE = 50


@final
@dataclass(frozen=True, kw_only=True)
class StepReport:
    """One step of training.

    Attributes:
        epoch: From 0.
        step: Within the epoch, from 1.
        images: In this step's batch.
        loss: Total.
        pncc: Its PNCC part, in units of the scale.
        offset: Its offset part, in units of the scale.
        learning_rate: In use.
    """

    epoch: int
    step: int
    images: int
    loss: float
    pncc: float
    offset: float
    learning_rate: float


@final
class LossLog:
    """Appends to a JSON-lines file.

    Args:
        path: Where to. Lines of ``first_epoch`` and later, left by an interrupted training, are dropped.
        first_epoch: The epoch that comes next.
    """

    def __init__(self, path: Path, first_epoch: int) -> None:
        self._path = path
        self._pending: list[StepReport] = []
        self._since = time.monotonic()
        path.parent.mkdir(parents=True, exist_ok=True)
        kept = _lines_before(path, first_epoch) if first_epoch and path.is_file() else []
        path.write_text("".join(kept), encoding="utf-8")

    def add(self, report: StepReport) -> None:
        """Takes a step; every 50th writes a line."""
        self._pending.append(report)
        if len(self._pending) >= STEPS_A_LINE:
            self.flush()

    def flush(self) -> None:
        """Writes the steps since the last line; called at the end of an epoch, so that no line spans two."""
        if not self._pending:
            return
        now = time.monotonic()
        images = sum(report.images for report in self._pending)
        line = asdict(self._pending[-1])
        del line["images"]
        for name in ("loss", "pncc", "offset"):
            mean = sum(getattr(report, name) * report.images for report in self._pending) / images
            line[name] = round(mean, 6)
        line["images_per_second"] = round(images / max(now - self._since, 1e-9), 1)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        self._pending, self._since = [], now


def _lines_before(path: Path, epoch: int) -> list[str]:
    """Complete lines of earlier epochs; a half line, from a crash while writing, goes."""
    kept = []
    for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
        try:
            if json.loads(line)["epoch"] < epoch:
                kept.append(line)
        except (ValueError, KeyError, TypeError):
            continue
    return kept
