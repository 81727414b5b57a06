"""Files that appear under their names only when they are complete."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4


@contextmanager
def written_in_one_step(path: Path, *, is_contended: bool = False) -> Iterator[Path]:
    """Yields a hidden name beside a file; what is written there takes the file's place when the block ends.

    The content has reached the disk before it is renamed. If the block raises, nothing is left of it, and an older file
    of the same name stays. The file's folder is made. The file has the permissions of any new file, whatever writes it.
    With ``is_contended``, several processes may write the same file at once: each has a hidden name of its own.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    unique = f".{uuid4().hex[:12]}" if is_contended else ""
    temporary = path.with_name(f".{path.name}{unique}.part")
    try:
        yield temporary
        usual = _mode_of_a_new_file(path.parent)
        if temporary.stat().st_mode != usual:  # safetensors makes files that only their owner can read
            temporary.chmod(usual)
        _sync(temporary)
        temporary.replace(path)
        _sync(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def _mode_of_a_new_file(folder: Path) -> int:
    """What umask and folder make of it. It is tried, since the umask can only be read by changing it for a while."""
    path = folder / f".{uuid4().hex[:12]}.part"
    try:
        path.touch()
        return path.stat().st_mode
    finally:
        path.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
