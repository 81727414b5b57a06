"""Weights & Biases and trackio get curves by the number of pictures; without them, the line that installs them."""

import sys
from types import SimpleNamespace

import pytest
from torch import nn

from pix2face.errors import UsageError
from training.loop.loss_log import StepReport
from training.loop.observers import observers_of
from training.loop.tracker_log import TrackerLog
from training.loop.validation import Scores

SCORES = Scores(pncc_mm=3.0, offset_mm=1.0, offset_zero_mm=2.0, mask_iou=0.9, nme=None)


def report_of(step: int) -> StepReport:
    parts = {"pncc": 0.25}
    return StepReport(
        epoch=0, step=step, samples=8 * step, images=8, loss=0.5, parts=parts, learning_rate=1e-3, waited_seconds=0.0
    )


@pytest.mark.parametrize("package", ["wandb", "trackio"])
def test_a_run_gets_its_options_and_every_fiftieth_step(package, monkeypatch):
    calls = []
    functions = {
        name: lambda *values, _name=name, **named: calls.append((_name, *values, named))
        for name in ("init", "log", "finish")
    }
    monkeypatch.setitem(sys.modules, package, SimpleNamespace(**functions))
    log = TrackerLog(package, "cpu", '{"seed": 3}')
    with observers_of(lambda *_, **__: None, 1, lambda: False, [log]) as observers:
        for step in (1, 49, 50):
            observers.on_step(report_of(step))
        observers.on_scores(400, SCORES, nn.Identity())
    losses = {"loss/total": 0.5, "loss/pncc": 0.25, "learning rate": 1e-3}
    scores = {"pncc_mm": 3.0, "offset_mm": 1.0, "offset_zero_mm": 2.0, "mask_iou": 0.9}
    assert calls == [
        ("init", {"project": "pix2face", "name": "cpu", "config": {"seed": 3}}),
        ("log", losses, {"step": 400}),
        ("log", {f"validation/{name}": value for name, value in scores.items()}, {"step": 400}),
        ("finish", {}),
    ]


def test_without_the_package_the_line_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(UsageError, match=r"--tracker wandb needs; run: pip install wandb"):
        TrackerLog("wandb", "cpu", "{}")
