"""From what a user names to files: folders and quoted patterns stand for the photographs in them."""

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
    """The files that are meant, in the order of the inputs, those of a folder or pattern in the order of their numbers.

    A folder stands for the pictures in it (not for those in its subfolders), a pattern such as ``photos/*.jpg`` for the
    files that match it (``**`` for any number of folders). Pictures that `pix2face` wrote itself are left out of both.

    A pattern without a match is taken for the name of a file. To be called before a network is loaded, which takes
    seconds: files that are not there are said at once, and do not end the run where others are there.

    Args:
        inputs: Files, folders and patterns.
        console: Where missing files are said.
        or_else: What else than photographs may be given, for messages.

    Raises:
        InputFileError: None of the files is there. The message names the first.
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
                raise UsageError(f"{given}: expected photographs ({known}) in the folder, found none")
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
    """The files, without overlays and other pictures that a run wrote beside the photographs."""
    ours = {
        folder / name
        for folder in {path.parent for path in paths}
        for own in read_results(folder)
        for name in own.files
    }
    return [path for path in paths if path.is_file() and not (path in ours and _is_picture(path))]
