"""Files that appear under their names only when they are complete."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import final
from uuid import uuid4

from pix2face.errors import WRITE_ERRORS


@contextmanager
def written_in_one_step(path: Path, *, is_contended: bool = False, is_synced: bool = True) -> Iterator[Path]:
    """Yields a hidden name beside a file; what is written there takes the file's place when the block ends.

    The content has reached the disk before it is renamed. If the block raises, nothing is left of it, and an older file
    of the same name stays. The file's folder is made. The file has the permissions of any new file, whatever writes it.
    With ``is_contended``, several processes may write the same file at once: each has a hidden name of its own.
    Without ``is_synced`` the content may reach the disk later: for what is quickly made again.

    Raises:
        OSError: The file cannot be written, for instance since the disk is full. The error names it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    unique = f".{uuid4().hex[:12]}" if is_contended else ""
    temporary = path.with_name(f".{path.name}{unique}.part")
    try:
        with naming_failed_writes(path):
            yield temporary
        usual = _mode_of_a_new_file(path.parent)
        if temporary.stat().st_mode != usual:  # safetensors makes files that only their owner can read
            temporary.chmod(usual)
        if is_synced:
            _sync(temporary)
        temporary.replace(path)
        if is_synced:
            _sync(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def write_file(path: Path, content: bytes | str) -> None:
    """Writes a small file (text as UTF-8) that appears under its name only when it is complete.

    Raises:
        OSError: The file cannot be written, for instance since the disk is full. The error names it.
    """
    with written_in_one_step(path, is_synced=False) as temporary:
        temporary.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)


@final
class GrowingFile:
    """A text file (UTF-8) that is written bit by bit; a context manager.

    It appears under its name when the block ends, also by an exception: what was written until then is wanted. If a
    write fails, nothing is left of it.

    Raises:
        OSError: The file cannot be written, for instance since the disk is full. The error names it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._unfinished = path.with_name(f".{path.name}.part")
        self._file = self._unfinished.open("w", newline="", encoding="utf-8")
        self._has_failed = False

    def __enter__(self) -> "GrowingFile":
        return self

    def __exit__(self, *error: object) -> None:
        try:
            with naming_failed_writes(self._path):
                self._file.close()
            if not self._has_failed:
                self._unfinished.replace(self._path)
        finally:
            self._unfinished.unlink(missing_ok=True)

    def write(self, text: str) -> None:
        """Appends a text.

        Raises:
            OSError: It cannot be written.
        """
        try:
            with naming_failed_writes(self._path):
                self._file.write(text)
        except OSError:
            self._has_failed = True
            raise


@contextmanager
def naming_failed_writes(path: Path) -> Iterator[None]:
    """Lets the errors of a failed write name the file.

    Neither Python nor libraries name it where a disk is full, and libraries have exceptions of their own for it.

    Raises:
        OSError: The block could not write.
    """
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
    except Exception as error:
        for number in WRITE_ERRORS:
            if os.strerror(number) in str(error):
                raise OSError(number, os.strerror(number), str(path)) from error
        raise


def _mode_of_a_new_file(folder: Path) -> int:
    """What umask and folder make of it. It is tried, since the umask can only be read by changing it for a while."""
    with suppress(AttributeError, OSError):  # some systems and file systems have no files without a name
        descriptor = os.open(folder, os.O_TMPFILE | os.O_WRONLY, 0o666)  # nothing is left of it after a kill -9
        try:
            return os.fstat(descriptor).st_mode
        finally:
            os.close(descriptor)
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
