"""Photographs without a face, those on their side, and boxes without a face."""

import json
from pathlib import Path

import numpy as np
import pytest
from skimage.data import astronaut

from pix2face.commands.cli import main
from tests.pix2face.photographs.seen_faces import write_checkpoint, write_picture
from tests.synthetic_models import small_head_model


@pytest.fixture
def untrained(tmp_path: Path) -> Path:
    return write_checkpoint(tmp_path / "untrained.safetensors", small_head_model())


def call(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def test_no_face_is_one_line_and_the_rest_is_done(
    untrained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    person = write_picture(tmp_path / "person.png", astronaut())
    empty = write_picture(tmp_path / "sky.png", np.full((200, 300, 3), 128, np.uint8))
    options = ("--largest", "--no-refine", "--checkpoint", untrained, "--out", tmp_path / "out")
    assert call("predict", empty, person, *options) == 3
    assert {path.name for path in (tmp_path / "out").glob("*-*")} == {"person-0.npz", "person-0-maps.png"}
    lines = capsys.readouterr().err.splitlines()
    (line,) = [line for line in lines if line.startswith(f"{empty}: no face found; ")]
    assert all(option in line for option in ("--box left top right bottom", "--smallest-face", "--min-score"))
    assert f"photographs: 2, faces: 1 -> {tmp_path / 'out'}" in lines


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_photographs_on_their_side_are_read(tmp_path: Path, turns: int) -> None:
    upright = write_picture(tmp_path / "upright.png", astronaut())
    turned = write_picture(tmp_path / "turned.png", np.ascontiguousarray(np.rot90(astronaut(), turns)))
    assert call("fit", upright, turned, "--mesh", "none", "--out", tmp_path / "out") == 0
    expected, found = (
        np.array(json.loads((tmp_path / "out" / f"{name}-0.json").read_text())["landmarks2d_px"])
        for name in ("upright", "turned")
    )
    for _ in range(turns):
        expected = np.column_stack([expected[:, 1], 512 - expected[:, 0]])
    assert np.linalg.norm(found - expected, axis=1).max() < 8  # of 100 pixels of the face
    assert not (tmp_path / "out" / "turned-1.json").exists()


def test_a_box_without_a_face_is_doubted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photograph = write_picture(tmp_path / "person.png", astronaut())
    for box, is_doubted in (((10, 10, 20, 20), True), ((176, 83, 279, 174), False)):
        assert call("fit", photograph, "--box", *box, "--mesh", "none", "--out", tmp_path / "out") == 0
        doubt = f"warning: {photograph}: person-0: the network expects an error of "
        assert (doubt in capsys.readouterr().err) == is_doubted
