"""A Sphinx directive that prints the `--help` of a program and of all its subcommands: `{command-help} datagen`.

The text comes from the programs themselves while the pages are built, so that it cannot be out of date.
"""

import contextlib
import importlib
import io
import os
import re
from collections.abc import Callable, Iterator, Sequence
from unittest import mock

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

PROGRAMS = {
    "datagen": "datagen.cli",
    "train": "training.cli",
    "evaluate": "pix2face.evaluation.evaluate_cli",
    "pix2face": "pix2face.commands.cli",
}
# Subcommands that the help of their program names in its text and not in a list.
IN_TEXT = {"train": ["export"], "evaluate": ["compare"]}
WIDTH = 96


def help_text(program: str, path: Sequence[str] = ()) -> str:
    """What `PROGRAM PATH... --help` prints, without the frames around its sections."""
    main: Callable[[Sequence[str]], int] = importlib.import_module(PROGRAMS[program]).main
    printed = io.StringIO()
    with (
        mock.patch.dict(os.environ, {"COLUMNS": str(WIDTH), "NO_COLOR": "1"}),
        contextlib.redirect_stdout(printed),
        contextlib.suppress(SystemExit),
    ):
        main([*path, "--help"])
    lines = (_without_frame(line) for line in printed.getvalue().splitlines())
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip()


def commands(program: str, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The program itself (an empty path) and each of its subcommands, parents first."""
    yield path
    usage = help_text(program, path).split("\n\n", 1)[0]
    listed = re.search(r"\[-h\] \{([\w,-]+)\}", usage)
    children = listed[1].split(",") if listed else []
    for child in [*children, *(IN_TEXT.get(program, []) if not path and not children else [])]:
        yield from commands(program, (*path, child))


def _without_frame(line: str) -> str:
    if line.startswith("╭"):
        return "\n" + line.strip("╭╮─ ").capitalize() + ":"
    if line.startswith("╰"):
        return ""
    return re.sub(r"^│(.*)│$", r" \1", line).rstrip()


class CommandHelp(SphinxDirective):
    """One section for each command of a program."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The sections."""
        program = self.arguments[0]
        sections: list[nodes.Node] = []
        for path in commands(program):
            name = " ".join((program, *path))
            section = nodes.section(ids=[nodes.make_id(name)], names=[name])
            section += nodes.title(name, "", nodes.literal(name, name))
            section += nodes.literal_block("", help_text(program, path), language="text")
            sections.append(section)
        return sections


def setup(app: Sphinx) -> dict[str, bool]:
    """Registers the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True}
