"""The way in for files from anybody: regular files only, of a size that their format needs.

What a file is and how large it is are looked up on the file that was opened, before the first byte of it is read: a
pipe would be waited for, a device has no end, and a sparse file may claim any size. What a file declares of itself is
held against its size with `largest_unfolded` before memory is taken.
"""

import errno
import io
import os
import stat
from codecs import BOM_UTF8
from collections.abc import Collection, Iterator
from pathlib import Path

from pix2face.errors import InputFileError

MB = 1 << 20
# Compressed arrays of a file may unfold to so many bytes, and above that to so many times the size of the file. Bases,
# landmarks and text stay far below: only arrays of one repeated value shrink more, and those are small.
UNFOLDED_BYTES = 32 * MB
UNFOLDED_RATIO = 16
LARGEST_LINE_BYTES = 1 * MB
_NO_FILE = "found a device, pipe or socket; name a file"
# What downloads leave in place of a file, whatever its format.
_LFS_START, _PAGE_STARTS = b"version https://git-lfs.github.com/spec/", (b"<!doctype html", b"<html")
_START_BYTES = 512


def is_regular(path: Path) -> bool:
    """Whether there is a regular file; names that no file can have are none."""
    return os.path.isfile(path)  # noqa: PTH113 (`Path.is_file` raises for such names)


def is_folder(path: Path) -> bool:
    """Whether there is a folder; names that no file can have are none."""
    return os.path.isdir(path)  # noqa: PTH112 (as above)


def walk_files(folder: Path, suffixes: tuple[str, ...], left_out: Collection[str] = ()) -> Iterator[Path]:
    """What lies below a folder under names that end in some suffixes, in lower case or not.

    A folder of such a name comes, too, so that whoever reads it says that it is no file. The ``._*`` files that macOS
    writes beside others are left out, and so are subfolders of the names ``left_out``. Links to folders are not
    followed, since they may form loops.
    """
    for root, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if name not in left_out)
        for name in sorted([*folders, *names]):
            if name.lower().endswith(suffixes) and not name.startswith("._"):
                yield Path(root) / name


def check_regular(path: Path, expected: str, largest_bytes: int) -> None:
    """Checks a file that a library opens by its name.

    Args:
        path: The file.
        expected: What it should be, for messages: "a picture".
        largest_bytes: Larger files are refused.

    Raises:
        InputFileError: It is missing, cannot be read, is too large, is no regular file (a folder, a device, a pipe), or
            is what a download left in its place (a pointer of Git LFS, an HTML page).
    """
    open_regular(path, expected, largest_bytes).close()


def open_regular(path: Path, expected: str, largest_bytes: int) -> io.BufferedReader:
    """Opens a file for reading; arguments and errors as `check_regular`."""
    try:
        # Path.open has no opener.
        file = open(path, "rb", opener=_open_at_once)  # noqa: SIM115 (closed below, or by the caller)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        raise InputFileError(f"{path}: expected {expected}, {_obstacle(path, error)}") from error
    found = os.fstat(file.fileno())
    problem = ""
    if not stat.S_ISREG(found.st_mode):
        problem = _NO_FILE
    elif found.st_size > largest_bytes:
        problem = f"found {_size(found.st_size)}, where at most {_size(largest_bytes)} are read"
    else:
        problem = _stand_in(os.pread(file.fileno(), _START_BYTES, 0))
    if problem:
        file.close()
        raise InputFileError(f"{path}: expected {expected}, {problem}")
    return file


def read_regular(path: Path, expected: str, largest_bytes: int) -> bytes:
    """Reads a file whole; arguments and errors as `check_regular`."""
    with open_regular(path, expected, largest_bytes) as file:
        return file.read()


def read_text_file(path: Path, expected: str, largest_bytes: int, encoding: str = "utf-8") -> str:
    """Reads a text file whole; arguments and errors as `check_regular`.

    Raises:
        InputFileError: As there, or it is not text in this encoding.
    """
    try:
        return read_regular(path, expected, largest_bytes).decode(encoding)
    except UnicodeDecodeError as error:
        raise InputFileError(f"{path}: expected {expected}, found binary data") from error


def text_lines(path: Path, expected: str, largest_bytes: int) -> Iterator[str]:
    """The lines of a text file in UTF-8, with their ends, one after the other; arguments as `check_regular`.

    Raises:
        InputFileError: As there, it is not UTF-8, or a line is longer than any that people or programs write.
    """
    with (
        open_regular(path, expected, largest_bytes) as file,
        io.TextIOWrapper(file, encoding="utf-8-sig", newline="") as text,
    ):
        try:
            while line := text.readline(LARGEST_LINE_BYTES):
                if len(line) >= LARGEST_LINE_BYTES:
                    raise InputFileError(f"{path}: expected {expected}, found a line of {LARGEST_LINE_BYTES} bytes")
                yield line
        except UnicodeDecodeError as error:
            raise InputFileError(f"{path}: expected {expected}, found binary data") from error


def largest_unfolded(stored_bytes: int) -> int:
    """How many bytes the arrays of a file may take in memory, all together, where it may be compressed."""
    return UNFOLDED_BYTES + UNFOLDED_RATIO * stored_bytes


def _open_at_once(name: str, flags: int) -> int:
    """To open a pipe without its other end would wait; for regular files the flag means nothing."""
    return os.open(name, flags | os.O_NONBLOCK)


def _stand_in(start: bytes) -> str:
    """What a file is that only stands for another one; empty where it is none."""
    if start.startswith(_LFS_START):
        return "found a pointer of Git LFS, not the file itself; fetch it with `git lfs pull`"
    if start.removeprefix(BOM_UTF8).lstrip().lower().startswith(_PAGE_STARTS):
        return "found an HTML page, as a server sends in place of a download; open its address in a browser"
    return ""


def _obstacle(path: Path, error: OSError | ValueError) -> str:
    if isinstance(error, IsADirectoryError):
        return "found a folder; name a file in it"
    if isinstance(error, FileNotFoundError):
        return "found no such file"
    if isinstance(error, OSError) and error.errno == errno.ENXIO:
        return _NO_FILE
    return f"cannot read it ({error.strerror if isinstance(error, OSError) else error})"


def _size(n_bytes: int) -> str:
    return f"{n_bytes / MB:.0f} MB" if n_bytes >= MB else f"{n_bytes / 1024:.0f} KB"
