"""Calls of ``pix2face`` that cannot work: one line that says why, status 2, and nothing written."""

from pathlib import Path

import numpy as np
import pytest

from pix2face.commands.cli import main
from pix2face.errors import UsageError
from pix2face.inference.predictor import Predictor
from pix2face.models.morphable_model import builtin_model
from tests.pix2face.photographs.seen_faces import write_checkpoint, write_picture
from tests.synthetic_models import small_head_model


@pytest.fixture
def photograph(tmp_path: Path) -> Path:
    return write_picture(tmp_path / "person.png", np.zeros((90, 100, 3), dtype=np.uint8))


@pytest.fixture
def untrained(tmp_path: Path) -> Path:
    return write_checkpoint(tmp_path / "untrained.safetensors", small_head_model())


def call(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def assert_one_line(capsys: pytest.CaptureFixture[str], message: str) -> str:
    error = capsys.readouterr().err
    assert error.startswith("pix2face: error: ")
    assert message in error
    assert error.count("\n") == 1
    return error


def test_a_checkpoint_of_another_model_names_both(
    untrained: Path, photograph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("fit", photograph, "--checkpoint", untrained, "--out", tmp_path / "out") == 2
    error = assert_one_line(capsys, "'small synthetic head'")  # what the checkpoint was trained for
    assert repr(builtin_model().name) in error
    assert "--model" in error


BAD_BOXES = [
    ("30", "20", "10", "90"),
    ("10", "90", "30", "20"),
    ("10", "10", "10", "10"),
    ("0", "0", "1e-9", "1e-9"),
    ("nan", "0", "10", "10"),
    ("0", "0", "inf", "10"),
    ("-1e300", "0", "1e300", "10"),
]


@pytest.mark.parametrize("command", ["predict", "fit"])
@pytest.mark.parametrize("box", BAD_BOXES)
def test_a_bad_box_is_one_line(
    command: str, box: tuple[str, ...], photograph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(command, photograph, "--box", *box, "--checkpoint", "any", "--out", tmp_path / "out") == 2
    assert_one_line(capsys, "expected --box left top right bottom")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf"])
def test_a_bad_regularisation_is_one_line(value: str, photograph: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("fit", photograph, "--checkpoint", "any", "--regularisation", value) == 2
    assert_one_line(capsys, "expected a positive --regularisation")


def test_without_photographs_one_line(untrained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("predict", "--checkpoint", untrained) == 2
    assert_one_line(capsys, "expected at least one photograph")


def test_a_missing_checkpoint_says_how_to_train(
    photograph: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert call("fit", photograph, "--checkpoint", "runs/none.safetensors") == 2
    assert_one_line(capsys, "runs/none.safetensors: no such file; `train --shards")


@pytest.fixture
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loading a network takes seconds: what is wrong with paths is said before."""

    def load(path: Path, device: str | None = None) -> Predictor:
        raise UsageError("the network is loaded")

    monkeypatch.setattr(Predictor, "load", load)


@pytest.mark.usefixtures("no_network")
@pytest.mark.parametrize("command", ["predict", "fit", "view", "track"])
def test_a_mistyped_name_is_said_before_a_network_is_loaded(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / ("out.html" if command == "view" else "out")
    assert call(command, tmp_path / "mistyped.png", "--out", out) == 2
    assert_one_line(capsys, f"{tmp_path}/mistyped.png: expected a ")
    assert not out.exists()


@pytest.mark.usefixtures("no_network")
@pytest.mark.parametrize("command", ["predict", "fit", "view"])
def test_a_mistyped_name_among_others_is_said_at_once(
    command: str, photograph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.html"
    assert call(command, photograph, tmp_path / "mistyped.png", "--out", out) == 2
    first, last = capsys.readouterr().err.splitlines()
    assert first.startswith(f"{tmp_path}/mistyped.png: expected a picture")
    assert last == "pix2face: error: the network is loaded"
    assert call(command, tmp_path / "a.png", tmp_path / "b.png", "--out", out) == 2
    assert_one_line(capsys, "/a.png: expected a picture")


@pytest.mark.usefixtures("no_network")
@pytest.mark.parametrize("command", ["predict", "fit", "view", "track"])
def test_a_mistyped_file_of_boxes_is_said_before_a_network_is_loaded(
    command: str, photograph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path if command == "track" else photograph  # a folder of frames
    assert call(command, source, "--boxes", tmp_path / "mistyped.csv", "--out", tmp_path / "out.html") == 2
    assert_one_line(capsys, f"{tmp_path}/mistyped.csv: expected ")


@pytest.mark.usefixtures("no_network")
@pytest.mark.parametrize("command", ["predict", "fit", "track"])
def test_a_file_in_place_of_the_output_folder_is_said_before_a_network_is_loaded(
    command: str, photograph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path if command == "track" else photograph
    assert call(command, source, "--out", photograph) == 2
    assert_one_line(capsys, f"{photograph}: expected a folder that can be written to, found that")
