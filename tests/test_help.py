"""Every help page of all four programs: complete, in one style, and with nothing of Python's inside."""

import io
import re
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import cache
from itertools import pairwise

import pytest

from datagen.cli import main as datagen
from pix2face import __version__
from pix2face.commands.cli import main as pix2face
from pix2face.evaluation.cli import main as evaluate
from training.cli import main as train
from training.recipe.presets import PRESETS

PROGRAMS: dict[str, Callable[[list[str]], int]] = {
    "datagen": datagen,
    "train": train,
    "evaluate": evaluate,
    "pix2face": pix2face,
}
PAGES = [
    "datagen",
    "datagen sample",
    "datagen appearance",
    "datagen render",
    "datagen empty",
    "datagen verify",
    "datagen preview",
    "datagen stats",
    "datagen card",
    "datagen export",
    "datagen doctor",
    "datagen model",
    "datagen model import",
    "datagen model info",
    "datagen model view",
    "datagen coeffs",
    "datagen coeffs convert",
    "datagen coeffs info",
    "datagen coeffs retarget",
    "datagen fit",
    "train",
    "train correction",
    "train detector",
    "train export",
    "evaluate",
    "evaluate compare",
    "pix2face",
    "pix2face predict",
    "pix2face fit",
    "pix2face track",
    "pix2face view",
    "pix2face export",
    "pix2face page",
    "pix2face landmarks",
    "pix2face landmarks select",
    "pix2face landmarks show",
]
# An option or a positional argument, the type, what it does, and its default or that it must be given.
OPTION = re.compile(r"^  (?P<name>-\S+|[A-Z]+)(?P<rest>.*)$")


@cache
def page(call: str) -> str:
    """A page without its frames."""
    program, *words = call.split()
    said = io.StringIO()
    with redirect_stdout(said), pytest.raises(SystemExit) as ended:
        PROGRAMS[program]([*words, "--help"])
    assert not ended.value.code
    return said.getvalue().replace("│", " ")


def subcommands(call: str, text: str) -> set[str]:
    """The subcommands that a page lists."""
    patterns = (r"^    • (\w+)", rf"^`{call} (\w+)`: \w")
    return {name for pattern in patterns for name in re.findall(pattern, text, re.MULTILINE)}


def options(text: str) -> dict[str, str]:
    """By the name of an option all that the page says of it."""
    found: dict[str, str] = {}
    name = ""
    for line in text.splitlines():
        if match := OPTION.match(line):
            name = match["name"].rstrip(",")
            found[name] = match["rest"]
        elif name and line.startswith("   "):
            found[name] += f" {line}"
        else:
            name = ""
    return {name: " ".join(said.split()) for name, said in found.items()}


def ragged_lines(text: str) -> list[str]:
    """Lines of descriptions that end before they are full, as where a docstring's own breaks are kept."""
    found = []
    for line, following in pairwise(text.splitlines()):
        column = len(following) - len(following.lstrip())
        continues = column > 5 and line[column - 2 : column] == "  " and line[column : column + 1].strip()
        if continues and "•" not in following and len(line.rstrip()) + 1 + len(following.split()[0]) < 78:
            found.append(line)
    return found


def is_described(said: str) -> bool:
    """Whether there are words beside types and defaults."""
    words = re.sub(r"\((default|required).*|--no-\S+|\{\S+\}", "", said)
    return len(re.findall("[a-z]{2,}", words)) >= 2


@pytest.mark.parametrize("call", PAGES)
def test_a_page_lists_all_its_subcommands(call):
    below = {
        other.split()[-1] for other in PAGES if other.startswith(f"{call} ") and other.count(" ") == call.count(" ") + 1
    }
    assert subcommands(call, page(call)) == below


@pytest.mark.parametrize("call", [*PAGES, *(f"train --preset {name}" for name in PRESETS)])
def test_a_page_is_complete_and_plain(call):
    text = page(call)
    assert "``" not in text
    assert "None" not in text
    assert "[]" not in text
    assert "(default: )" not in text
    assert "''" not in text
    assert not ragged_lines(text)
    found = options(text)
    assert "-h" in found
    for name, said in found.items():
        assert is_described(said), (name, said)


def test_faults_of_a_page_would_be_noticed():
    text = "  --out PATH  (required)\n  --n INT     Number of\n              faces.\n"
    found = options(text)
    assert found == {"--out": "PATH (required)", "--n": "INT Number of faces."}
    assert [is_described(said) for said in found.values()] == [False, True]
    assert ragged_lines(text) == ["  --n INT     Number of"]


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_program_says_its_version(program, capsys):
    assert PROGRAMS[program](["--version"]) == 0
    assert capsys.readouterr().out == f"{program} {__version__}\n"
    assert f"`{program} --version` prints the version." in page(program)
