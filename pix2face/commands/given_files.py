"""Finds the files that a user names: files, folders and quoted patterns."""

import glob
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from pix2face.command_line import counted, say
from pix2face.commands.result_folder import read_results
from pix2face.errors import InputFileError, UsageError
from pix2face.files.images import LARGEST_FILE_BYTES, PHOTOGRAPH_SUFFIXES
from pix2face.files.opening import check_regular
from pix2face.tracking.video import by_number


def given_files(inputs: Sequence[Path], console: Console, or_else: str = "") -> list[Path]:
    """Lists the files of all inputs, in the order of the inputs.

    A folder stands for the pictures in it, without subfolders. A pattern such as ``photos/*.jpg`` stands for the files
    that match it; ``**`` matches any number of folders. Both are sorted by name, with numbers by their value, and leave
    out pictures that `pix2face` wrote. A pattern without a match is taken as the name of a file.

    Call this before a network is loaded, which takes seconds. Missing files are reported at once, and end the run only
    if all are missing.

    Args:
        inputs: Files, folders and patterns.
        console: Where missing files are reported.
        or_else: What may be given besides photographs, for messages.

    Raises:
        InputFileError: No file can be read. The message names the first.
        UsageError: There is no input, or a folder has no picture.
    """
    if not inputs:
        raise UsageError(f"expected at least one photograph{or_else}")
    files: list[Path] = []
    for given in inputs:
        if given.is_dir():
            found = _without_results([path for path in given.iterdir() if _is_picture(path)])
            if not found:
                known = ", ".join(PHOTOGRAPH_SUFFIXES)
                fits = f"; name the fits in it as '{given}/*.json'" if or_else and any(given.glob("*.json")) else ""
                raise UsageError(f"{given}: expected photographs ({known}) in the folder, found none{fits}")
        elif glob.has_magic(str(given)) and not given.exists():
            matches = glob.glob(str(given), recursive=True)  # noqa: PTH207 (Path.glob takes no absolute pattern)
            found = _without_results([Path(name) for name in matches]) or [given]
        else:
            found = [given]
        files += sorted(found, key=lambda path: (str(path.parent), by_number(path)))
    _check_some_are_there(files, console, f"a picture{or_else}")
    return files


def _check_some_are_there(files: Sequence[Path], console: Console, expected: str) -> None:
    obstacles = []
    for path in files:
        try:
            check_regular(path, expected, LARGEST_FILE_BYTES)
        except InputFileError as error:
            obstacles.append(str(error))
    if len(obstacles) == len(files):
        more = len(obstacles) - 1
        raise InputFileError(obstacles[0] + (f"; {counted(more, 'other')} cannot be read either" if more else ""))
    for obstacle in obstacles:
        say(console, obstacle)


def _is_picture(path: Path) -> bool:
    return path.suffix.lower() in PHOTOGRAPH_SUFFIXES and not path.name.startswith(".")


def _without_results(paths: Sequence[Path]) -> list[Path]:
    """Leaves out overlays and other pictures that an earlier run wrote."""
    ours = {
        folder / name
        for folder in {path.parent for path in paths}
        for own in read_results(folder)
        for name in own.files
    }
    return [path for path in paths if path.is_file() and not (path in ours and _is_picture(path))]
