"""A Sphinx directive that shows the `--help` of a program and of all its subcommands: `{command-help} datagen`.

The text comes from the programs themselves while the pages are built, so that it cannot be out of date.
"""

import contextlib
import functools
import importlib
import io
import os
import re
from collections.abc import Iterator, Sequence
from unittest import mock

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

PROGRAMS = {
    "datagen": "datagen.cli",
    "train": "training.cli",
    "evaluate": "pix2face.evaluation.cli",
    "pix2face": "pix2face.commands.cli",
}
CODE = re.compile(r"(`+[^`]+`+|(?<![\w-])--[a-z][\w-]*)")


@functools.cache
def help_text(program: str, path: Sequence[str] = ()) -> str:
    """What `PROGRAM PATH... --help` prints to a stream that knows no encoding: plain lines without frames."""
    main = importlib.import_module(PROGRAMS[program]).main
    printed = io.StringIO()
    with (
        mock.patch.dict(os.environ, {"COLUMNS": "200", "NO_COLOR": "1"}),
        contextlib.redirect_stdout(printed),
        contextlib.suppress(SystemExit),
    ):
        main([*path, "--help"])
    return printed.getvalue()


def commands(program: str, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The program itself (an empty path) and each of its subcommands, parents first."""
    yield path
    if path:
        listed = re.match(r"usage: .*?\[-h\][^{}\n]*\{([\w,-]+)\}\s*(\[|\n)", help_text(program, path))
        children = listed[1].split(",") if listed else []
    else:
        children = [name for name in importlib.import_module(PROGRAMS[program]).COMMANDS if name]
    for child in children:
        yield from commands(program, (*path, child))


def described(text: str) -> list[nodes.Node]:
    """Help as paragraphs, and a list of names and texts for each section: arguments, options, subcommands."""
    lines = [line.rstrip() for line in text.splitlines()]
    rules = [i for i, line in enumerate(lines) if line and not line.strip(" -")]
    end = rules[0] - 1 if rules else len(lines)
    _usage, *paragraphs = re.split(r"\n{2,}", "\n".join(lines[:end]).strip())
    shown: list[nodes.Node] = [nodes.paragraph("", "", *_with_code(" ".join(text.split()))) for text in paragraphs]
    for start, stop in zip(rules, [*rules[1:], len(lines)], strict=True):
        entries = _entries(lines[start + 1 : stop])
        if len(entries):
            shown += [nodes.rubric("", lines[start - 1].strip().capitalize()), entries]
    return shown


def _entries(lines: Sequence[str]) -> nodes.definition_list:
    """An entry begins at the margin of its section, or with a bullet; what is indented further is its text."""
    entries: list[tuple[str, list[str]]] = []
    for line in lines:
        begins = re.match(r" {2}(?=[-A-Z{])| *• ", line)
        if begins:
            name, *help_text = re.split(r" {2,}", line[begins.end() :], maxsplit=1)
            entries.append((name, help_text))
        elif entries and line.startswith("   "):
            entries[-1][1].append(line)
    return nodes.definition_list(
        "",
        *(
            nodes.definition_list_item(
                "",
                nodes.term("", "", nodes.literal(name, name)),
                nodes.definition("", nodes.paragraph("", "", *_with_code(" ".join(" ".join(text).split())))),
            )
            for name, text in entries
            if name != "-h, --help"
        ),
    )


def _with_code(text: str) -> list[nodes.Node]:
    """Text in which backticks mark code, and so do the dashes of an option."""
    parts = CODE.split(text)
    return [nodes.literal(part, part.strip("`")) if i % 2 else nodes.Text(part) for i, part in enumerate(parts) if part]


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
            section += described(help_text(program, path))
            sections.append(section)
        return sections


def setup(app: Sphinx) -> dict[str, bool]:
    """Registers the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True}
