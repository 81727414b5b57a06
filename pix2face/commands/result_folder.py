"""The folder that a command for photographs writes to, with the files of earlier runs.

The files of a photograph are written to a hidden folder, and moved when all of them are complete. The list `LIST_NAME`
in the folder says which files belong to which photograph, so that a later run replaces only its own.
"""

import json
import os
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, final
from uuid import uuid4

from pix2face.command_line import prepare_output_folder
from pix2face.errors import InputFileError
from pix2face.files.opening import is_regular, read_regular
from pix2face.files.writing import write_file

LIST_NAME = "results.jsonl"
# Enough for some hundred thousand photographs.
LARGEST_LIST_BYTES = 256 << 20

Command = Literal["fit", "predict"]


@final
@dataclass(frozen=True)
class Results:
    """One line of the list: the files of one photograph."""

    command: str
    photograph: str  # path relative to the folder
    name: str  # name of its files
    files: tuple[str, ...]


@final
class ResultFolder:
    """Writes the results of a run to a folder, photograph by photograph.

    Args:
        folder: The folder, which is made if it does not exist.
        command: The command that is run. Results of other commands are kept.

    Raises:
        UsageError: The folder cannot be written to.
    """

    def __init__(self, folder: Path, command: Command) -> None:
        prepare_output_folder(folder)
        self.path = folder
        self._command = command
        earlier = read_results(folder)
        self._claims = Counter(file for own in earlier for file in own.files)
        self._earlier = {own.name: own for own in earlier if own.command == command}
        self._names = {own.photograph: own.name for own in self._earlier.values()}
        if (folder / LIST_NAME).exists():
            write_file(folder / LIST_NAME, "".join(map(_as_line, earlier)))

    @contextmanager
    def of_photograph(self, name: str, photograph: Path) -> Iterator[Path]:
        """Yields an empty folder for the files of a photograph, which are moved to the results when the block ends.

        They replace the files that earlier runs of the command wrote under this name, or for this photograph under
        another name. If the block raises, nothing changes.
        """
        part = self.path / f".{uuid4().hex[:12]}.part"
        part.mkdir()
        try:
            yield part
            made = sorted(path.name for path in part.iterdir())
            way = os.path.relpath(photograph.absolute(), self.path.absolute())
            # Before files are moved, so that the list knows all of them even after a crash.
            self._claims.update(made)
            with (self.path / LIST_NAME).open("a", encoding="utf-8") as file:
                file.write(_as_line(Results(self._command, way, name, tuple(made))))
            self._remove_earlier({name, self._names.get(way, name)}, set(made))
            for file_name in made:
                (part / file_name).replace(self.path / file_name)
        finally:
            shutil.rmtree(part, ignore_errors=True)

    def _remove_earlier(self, names: set[str], made: set[str]) -> None:
        for earlier in [self._earlier.pop(name) for name in names if name in self._earlier]:
            self._claims.subtract(earlier.files)
            for file_name in earlier.files:
                if self._claims[file_name] <= 0 and file_name not in made:
                    (self.path / file_name).unlink(missing_ok=True)


def read_results(folder: Path) -> list[Results]:
    """Reads the list of a folder, without lines that later ones replace. Returns no results if it cannot be read."""
    path = folder / LIST_NAME
    if not is_regular(path):
        return []
    try:
        lines = read_regular(path, "a list of results", LARGEST_LIST_BYTES).splitlines()
    except InputFileError:
        return []
    return list({(own.command, own.name): own for own in map(_from_line, lines) if own}.values())


def _as_line(results: Results) -> str:
    return json.dumps(asdict(results)) + "\n"


def _from_line(line: bytes) -> Results | None:
    """Parses a line of a list; None if it is invalid. Files outside the folder are ignored."""
    try:
        fields = json.loads(line)
        command, photograph, own_name = (fields[name] for name in ("command", "photograph", "name"))
        files = [name for name in fields["files"] if Path(name).name == name and name not in ("", ".", "..")]
    except (ValueError, TypeError, KeyError, RecursionError):
        return None
    if not all(isinstance(text, str) for text in (command, photograph, own_name)):
        return None
    return Results(command, photograph, own_name, tuple(files))
