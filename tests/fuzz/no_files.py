"""What is under a file's name and is no file of its format: pipes, devices, folders, giants, names that cannot be."""

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from pix2face.errors import InputFileError, Pix2FaceError
from tests.fuzz.grammar import Grammar
from tests.fuzz.limits import Case


def _giant(path: Path) -> None:
    path.touch()
    os.truncate(path, 2 << 30)


KINDS: dict[str, Callable[[Path], object]] = {
    "pipe": os.mkfifo,
    "random": lambda path: path.symlink_to("/dev/urandom"),
    "zero": lambda path: path.symlink_to("/dev/zero"),
    "folder": Path.mkdir,
    "giant": _giant,
    "loop": lambda path: path.symlink_to(path.name),
    "long": lambda path: None,
    "words": lambda path: path.write_text("words\n"),
}


def no_files(folder: Path, grammars: Mapping[str, Grammar]) -> list[Case]:
    """A case for each reader and kind; each must be refused."""
    cases: list[Case] = []
    for number, (name, grammar) in enumerate(grammars.items()):
        for kind, make in KINDS.items():
            path = folder / f"{number}-{kind}{'x' * 300 * (kind == 'long')}{grammar.suffix}"
            make(path)
            cases.append(partial(_refused, name, kind, grammar.read, path))
    return cases


def _refused(name: str, kind: str, read: Callable[[Path], object], path: Path) -> None:
    try:
        read(path)
    except Pix2FaceError as error:
        raise InputFileError(str(error)) from error
    except BaseException as error:
        raise AssertionError(f"{name}, {kind}: {type(error).__name__}: {error}"[:300]) from error
    if name != "ply":  # a fit without a point cloud is one
        raise AssertionError(f"{name}, {kind}: read")
