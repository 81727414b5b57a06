"""A file is there whole or not at all."""

import os
from pathlib import Path

import pytest

from pix2face.files.writing import written_in_one_step


def test_the_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "new folder" / "a.txt"
    with written_in_one_step(path) as temporary:
        temporary.write_text("whole")
        assert not path.exists()
    assert path.read_text() == "whole"
    assert list(path.parent.iterdir()) == [path]
    ordinary = tmp_path / "ordinary"
    ordinary.touch()
    assert path.stat().st_mode == ordinary.stat().st_mode


def write_half(path: Path, failure: type[BaseException]) -> None:
    path.write_text("half")
    raise failure


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt])
def test_a_failure_leaves_the_older_file(tmp_path: Path, failure: type[BaseException]) -> None:
    path = tmp_path / "a.txt"
    path.write_text("older")
    with pytest.raises(failure), written_in_one_step(path) as temporary:
        write_half(temporary, failure)
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]


def test_contending_writers_have_names_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with (
        written_in_one_step(path, is_contended=True) as first,
        written_in_one_step(path, is_contended=True) as second,
    ):
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]


def test_content_reaches_the_disk_before_it_is_renamed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, synced = tmp_path / "a.txt", list[tuple[str, bool]]()
    monkeypatch.setattr(
        os, "fsync", lambda file: synced.append((str(Path(f"/proc/self/fd/{file}").readlink()), path.exists()))
    )
    with written_in_one_step(path) as temporary:
        temporary.write_text("whole")
    assert synced == [(str(temporary), False), (str(tmp_path), True)]
