"""A file is there whole or not at all."""

import errno
import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from pix2face.files.writing import write_file, written_in_one_step


def test_the_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "new folder" / "a.txt"
    with written_in_one_step(path) as temporary:
        temporary.write_text("whole")
        assert not path.exists()
    assert path.read_text() == "whole"
    assert list(path.parent.iterdir()) == [path]


def replace_by_a_private_file(path: Path) -> None:
    private = path.with_name("private")
    private.touch(mode=0o600)
    private.replace(path)


@pytest.mark.parametrize("write", [lambda path: path.write_text("whole"), replace_by_a_private_file])
@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_the_umask_decides_on_the_permissions(
    tmp_path: Path, umask: int, mode: int, write: Callable[[Path], object]
) -> None:
    (tmp_path / ".a.part").touch(mode=0o640)  # of a run that was killed
    before = os.umask(umask)
    try:
        with written_in_one_step(tmp_path / "a") as temporary:
            write(temporary)
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == mode


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


FULL = "No space left on device"


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, FULL), ValueError(f"I/O error: {FULL}")])
def test_a_full_disk_names_the_file_and_leaves_the_old_one(error: Exception, tmp_path: Path) -> None:
    path = tmp_path / "table.h5"
    write_file(path, "old")

    def fail() -> None:
        with written_in_one_step(path) as unfinished:
            unfinished.write_text("half")
            raise error

    with pytest.raises(OSError, match=rf"{FULL}: '\S*/table\.h5'"):
        fail()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
