"""What the command lines share: exit statuses, checks of output paths, messages and progress bars."""

import json
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any, Literal, final, get_args

import tyro
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from pix2face.errors import UsageError
from pix2face.files.writing import written_in_one_step

EXIT_ERROR = 2
EXIT_REJECTED = 3
REJECTED_FILE = "rejected.jsonl"
# Of progress in a log.
SECONDS_BETWEEN_LINES = 60.0


def optional(metavar: str) -> Any:
    """Annotates an option that may be left out: help shows ``metavar`` as its type, and no default."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint="")


def choices(literal: Any) -> str:
    """Formats the values of a ``Literal`` as in help: {a,b}."""
    return "{" + ",".join(get_args(literal)) + "}"


def prepare_output_folder(path: Path) -> None:
    """Makes the folder that a command writes to, with its parents. Call this before anything takes time.

    Raises:
        UsageError: The folder cannot be made, or cannot be written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        obstacle = next((place for place in (path, *path.parents) if _kind(place) == "file"), None)
        found = f"found that {obstacle} is a file" if obstacle else f"found: {error.strerror}"
        raise UsageError(f"{path}: expected a folder that can be written to, {found}; choose another --out") from error
    _check_writable(path, path)


def check_output_folder(path: Path) -> None:
    """Checks that a command can write to a folder, without making it. Call this before anything takes time.

    Raises:
        UsageError: The path or a parent of it is a file, or there is no permission to write.
    """
    nearest = next(place for place in (path.absolute(), *path.absolute().parents) if _kind(place))
    if _kind(nearest) == "file":
        raise UsageError(
            f"{path}: expected a folder that can be written to, found that {nearest} is a file; choose another --out"
        )
    _check_writable(path, nearest)


def check_output_file(path: Path, suffixes: Sequence[str]) -> None:
    """Checks that a command can write its output file, without making it. Call this before anything takes time.

    Args:
        path: The file; its folder need not exist yet.
        suffixes: The allowed suffixes, such as ".h5"; case is ignored.

    Raises:
        UsageError: The suffix is another one, the path is a folder, or there is no permission to write.
    """
    if path.suffix.lower() not in suffixes:
        found = repr(path.suffix) if path.suffix else "no ending"
        known = " or ".join([", ".join(suffixes[:-1]), suffixes[-1]] if len(suffixes) > 1 else suffixes)
        raise UsageError(f"{path}: expected a file ending in {known} as --out, found {found}")
    if _kind(path) == "folder":
        raise UsageError(f"{path}: expected a file to write, found a folder; choose another --out")
    nearest = next(place for place in path.absolute().parents if _kind(place))
    if _kind(nearest) == "file":
        raise UsageError(f"{path}: expected a folder to write to, found that {nearest} is a file; choose another --out")
    _check_writable(path, nearest)


def check_max_rejected(max_rejected: int) -> None:
    """Checks the option ``--max-rejected``.

    Raises:
        UsageError: The number is negative.
    """
    if max_rejected < 0:
        raise UsageError(f"--max-rejected: expected 0 or more, found {max_rejected}")


def write_rejected(path: Path, rejected: Iterable[tuple[str, str]]) -> None:
    """Writes id and reason of each rejected sample, one JSON object per line."""
    lines = (json.dumps({"sample_id": sample_id, "reason": reason}) for sample_id, reason in rejected)
    with written_in_one_step(path) as temporary:
        temporary.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def counted(n: int, noun: str) -> str:
    """Formats a number with its noun: "1 shard", "2 shards"."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def _kind(place: Path) -> Literal["folder", "file"] | None:
    """Returns what a path is; None if nothing is there, the name is too long, or there is no permission."""
    try:
        mode = place.stat().st_mode
    except OSError:
        return None
    return "folder" if stat.S_ISDIR(mode) else "file"


def _check_writable(path: Path, folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UsageError(
            f"{path}: expected a folder that can be written to, found no permission to write to {folder}; "
            "choose another --out"
        )


def say(console: Console, message: str) -> None:
    """Prints one line without interpreting markup, emoji codes or control characters in it."""
    console.print(Text(printable(message)), soft_wrap=True)


def printable(text: str) -> str:
    """Escapes the control characters in a text."""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode() for character in text
    )


@final
class _RateColumn(ProgressColumn):
    """Items per second."""

    def render(self, task: Task) -> Text:
        """Returns the rate; empty until an item is done."""
        rate = task.finished_speed or task.speed
        return Text("" if rate is None else f"{rate:.1f}/s" if rate < 100 else f"{rate:.0f}/s")


@contextmanager
def progress_bar(console: Console, what: str, total: int | None) -> Iterator[Callable[..., None]]:
    """Shows a progress bar with rate and remaining time. Its length is unknown if ``total`` is None.

    Where there is no terminal, a line is printed every ``SECONDS_BETWEEN_LINES`` instead, and the bar at the end.

    Yields:
        ``advance(n=1, note="", already_done=False)``: adds n items, and shows a note behind the bar. Items that were
        already done do not count for the rate.
    """
    columns: list[Any] = [
        TextColumn("[bold]{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TaskProgressColumn(),
        _RateColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    ]
    with Progress(*columns, console=console, refresh_per_second=4) as progress:
        task = progress.add_task(what, total=total, note="")
        said = monotonic()

        def advance(n: int = 1, note: str = "", already_done: bool = False) -> None:
            if already_done:
                progress.reset(task, completed=n)
            else:
                progress.update(task, advance=n, note=note)
            nonlocal said
            if not console.is_terminal and monotonic() - said >= SECONDS_BETWEEN_LINES:
                said, out_of = monotonic(), f" of {total}" if total else ""
                say(console, f"{what}: {progress.tasks[task].completed:.0f}{out_of} {note}".rstrip())

        yield advance
