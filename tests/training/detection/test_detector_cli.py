"""The command ``train detector``: it goes on exactly where it was interrupted, and its detector can be used."""

from pathlib import Path

import numpy as np
import pytest

from pix2face.detectors.centre_detector import CentreDetector
from pix2face.inference.centre_files import load_detector
from training import task_run
from training.cli import main
from training.loop.trainer import Observers, train_task


def arguments(people: Path, backgrounds: Path, out: Path, *more: str) -> list[str]:
    options = {"size-px": 64, "batch-size": 2, "epochs": 2, "epoch-size": 4, "norm-batches": 2, "workers": 0}
    numbers = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    return ["detector", "--shards", str(people), "--backgrounds", str(backgrounds), "--out", str(out), *numbers, *more]


def test_a_training_goes_on_where_it_was_stopped(
    people_dir: Path, backgrounds_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    assert main(arguments(people_dir, backgrounds_dir, tmp_path / "whole")) == 0

    def stopped(task, out, surroundings, observers):
        return train_task(task, out, surroundings, observers=Observers(should_stop=lambda: True))

    with monkeypatch.context() as patch:
        patch.setattr(task_run, "train_task", stopped)
        patch.setattr(task_run, "exit_of", lambda signals: 143)
        assert main(arguments(people_dir, backgrounds_dir, tmp_path / "parts")) == 143
    assert main(arguments(people_dir, backgrounds_dir, tmp_path / "parts", "--seed", "3")) == 2
    assert "holds a training with another configuration (seed 0 -> 3)" in capsys.readouterr().err
    assert main(arguments(people_dir, backgrounds_dir, tmp_path / "parts")) == 0
    whole, parts = ((tmp_path / name / "checkpoint.safetensors") for name in ("whole", "parts"))
    assert whole.read_bytes() == parts.read_bytes()
    header, _ = load_detector(whole)
    assert (header.samples, header.licence) == (8, "CC0-1.0")
    assert CentreDetector.load(whole).candidates(np.zeros((30, 40, 3), np.uint8)) is not None


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--size-px", "100", "expected a multiple of 32, found 100"),
        ("--ema", "1", "expected 0 or more and less than 1, found 1.0"),
        ("--epochs", "0", "expected a finite number above 0, found 0"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(
    people_dir: Path, backgrounds_dir: Path, tmp_path: Path, capsys, option: str, value: str, message: str
) -> None:
    assert main(arguments(people_dir, backgrounds_dir, tmp_path / "out", option, value)) == 2
    assert f"{option}: {message}" in capsys.readouterr().err
