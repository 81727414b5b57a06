"""Pictures without people."""

from pathlib import Path

import numpy as np
import pytest

from datagen.appearance.backdrop import empty_pictures
from datagen.appearance.backdrop.empty_pictures import draw_empty_picture
from datagen.cli import main
from pix2face.files.images import read_photograph


@pytest.mark.parametrize("held_out", [False, True])
def test_what_is_drawn_depends_on_the_generator_alone(held_out: bool) -> None:
    pictures = [draw_empty_picture(np.random.default_rng(seed), 48, held_out=held_out) for seed in range(12)]
    for seed, picture in enumerate(pictures):
        assert picture.shape == (48, 48, 3)
        np.testing.assert_array_equal(draw_empty_picture(np.random.default_rng(seed), 48, held_out=held_out), picture)
    assert len({picture.tobytes() for picture in pictures}) == 12


@pytest.mark.parametrize("held_out", [False, True])
def test_what_is_held_out_is_never_drawn_for_training(held_out: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: set[str] = set()

    def note(rng: np.random.Generator, name: str, size_px: int) -> np.ndarray:
        drawn.add(name)
        return np.zeros((size_px, size_px, 3), np.uint8)

    monkeypatch.setattr(empty_pictures, "_environment", note)
    monkeypatch.setattr(empty_pictures, "_part", note)
    monkeypatch.setattr(empty_pictures, "_picture", str)
    for seed in range(300):
        draw_empty_picture(np.random.default_rng(seed), 8, held_out=held_out)
    kept = {*empty_pictures.HELD_OUT_ENVIRONMENTS, *empty_pictures.HELD_OUT_PICTURES}
    assert len(drawn) > 5
    assert drawn <= kept if held_out else not drawn & kept


def test_the_command_writes_pictures(tmp_path: Path) -> None:
    assert main(["empty", "--n", "3", "--size", "32", "--out", str(tmp_path)]) == 0
    assert [read_photograph(path).shape for path in sorted(tmp_path.glob("*.jpg"))] == [(32, 32, 3)] * 3
