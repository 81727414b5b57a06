"""The documentation: its links, the commands that it quotes, and the site that is built from it."""

import functools
import importlib
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from pix2face.programs import Command, run_commands

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
FOLDERS = ("datagen", "docs", "examples", "manifests", "pix2face", "scripts", "tests", "training")
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]

sys.path.append(str(ROOT / "docs"))
from command_help import PROGRAMS, commands, help_text  # noqa: E402  (an extension of Sphinx, beside the pages)

# Of docker, dask and torchrun, and of a benchmark whose options are the fields of a class.
FOREIGN_OPTIONS = {
    "--build-arg",
    "--group-add",
    "--gpus",
    "--shm-size",
    "--user",
    "--nproc-per-node",
    "--nthreads",
    "--curve-steps",
    "--curve-size-px",
}


def relative_links(text: str) -> set[str]:
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    return {target for target in targets if not target.startswith(("http:", "https:", "mailto:", "#"))}


def commands_in_blocks(text: str) -> list[str]:
    """The calls of our programs in indented blocks, without comments."""
    lines = [line.split(" # ")[0] for line in text.splitlines() if line.startswith("    ")]
    parts = [re.sub(r" > [\w./-]+$", "", part.strip()) for line in lines for part in line.split("&&")]
    return [part for part in parts if re.match(rf"({'|'.join(PROGRAMS)}) [\w-]", part)]


def commands_in_prose(text: str) -> list[str]:
    """The calls in single backticks that have an option; they may leave out what is required."""
    spans = [re.sub(r"\s+", " ", span) for span in re.findall(r"(?<!`)`([^`]+)`(?!`)", text)]
    return [span for span in spans if re.match(rf"({'|'.join(PROGRAMS)}) [\w-]", span) and "--" in span]


def options_of(program: str, words: list[str]) -> set[str]:
    """The options of the subcommand that the words begin with."""
    path = max((path for path in subcommands(program) if list(path) == words[: len(path)]), key=len)
    return set(re.findall(r"--[a-z][\w-]*", help_text(program, path)))


@functools.cache
def subcommands(program: str) -> list[tuple[str, ...]]:
    return list(commands(program))


@functools.cache
def all_options() -> set[str]:
    """The options of all our programs, and of the scripts and benchmarks, which use argparse."""
    sources = [
        path.read_text(encoding="utf-8") for folder in ("scripts", "tests") for path in ROOT.glob(f"{folder}/**/*.py")
    ]
    of_scripts = set(re.findall(r'"(--[a-z][\w-]*)"', "\n".join(sources)))
    return of_scripts.union(*(options_of(program, list(path)) for program in PROGRAMS for path in subcommands(program)))


def parse(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Parses a command line as its program does, and runs nothing."""
    module = importlib.import_module(PROGRAMS[words[0]])

    def run_stubs(program: str, description: str, given: Mapping[str, Command], arguments: list[str]) -> int:
        # No default: the files that command lines start from are not there.
        stubs = {name: replace(own, function=lambda options: 0, default=None) for name, own in given.items()}
        return run_commands(program, description, stubs, arguments)

    monkeypatch.setattr(module, "run_commands", run_stubs)
    assert module.main(words[1:]) == 0


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_relative_links_lead_somewhere(page: Path) -> None:
    links = relative_links(page.read_text(encoding="utf-8"))
    assert not {link for link in links if not (page.parent / link.partition("#")[0]).exists()}


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_places_in_the_repository_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    places = re.findall(rf"`((?:{'|'.join(FOLDERS)})/[^\s`]*)`", text)
    modules = re.findall(rf"python\s+-m\s+((?:{'|'.join(FOLDERS)})[\w.]+)", text)
    paths = [module.rstrip(".").replace(".", "/") for module in modules]
    assert not {place for place in places if not any(ROOT.glob(place.rstrip("/")))}
    assert not {
        path for path in paths if not ((ROOT / f"{path}.py").exists() or (ROOT / path / "__main__.py").exists())
    }


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_quoted_commands_parse(page: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for command in commands_in_blocks(page.read_text(encoding="utf-8")):
        try:
            parse(shlex.split(command), monkeypatch)
        except SystemExit:
            pytest.fail(f"{command}\n{capsys.readouterr()}")


def test_commands_are_found_and_wrong_ones_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert {command.split()[0] for command in commands_in_blocks(text)} == set(PROGRAMS)
    with pytest.raises(SystemExit):
        parse(["datagen", "sample", "--out", "faces.h5", "--no-such-option", "1"], monkeypatch)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_options_named_in_prose_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for command in commands_in_prose(text):
        program, *words = command.split()
        named = {word.partition("=")[0] for word in words if word.startswith("--")}
        assert named <= options_of(program, words), command
    alone = set(re.findall(r"(?<!`)`(--[a-z][\w-]*)", text))
    assert alone <= all_options() | FOREIGN_OPTIONS


def test_the_page_of_the_python_interface_is_whole() -> None:
    """It has what packages export, and what other pages tell readers to import or call."""
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    modules = set(re.findall(r"automodule:: ([\w.]+)", page))
    objects = set(re.findall(r"auto(?:class|function|data):: ([\w.]+)", page))
    named = set()
    for text in (path.read_text(encoding="utf-8") for path in PAGES if path.name != "python.md"):
        for module, names in re.findall(r"from (pix2face[\w.]*) import ([\w, ]+)", text):
            named |= {f"{module}.{name.strip()}" for name in names.split(",")}
    for package in ("pix2face", "pix2face.shards", "pix2face.detectors.detection"):
        exported = importlib.import_module(package).__all__
        named |= {f"{package}.{name}" for name in exported if not name.startswith("__")}
    assert "pix2face.Pix2Face" in named
    documented = {name for name in named if name in objects or name.rpartition(".")[0] in modules}
    assert named - documented == set()


def test_the_site_builds_strictly_and_needs_no_network(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-n", "-q", "-d", tmp_path / "trees"]
    run = subprocess.run([*build, ROOT / "docs", tmp_path / "site"], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    index = (tmp_path / "site" / "searchindex.js").read_text(encoding="utf-8")
    assert all(f'"{stem}":' in index for stem in ("pncc", "silhouett"))  # Sphinx searches by stems of words
    assert "--coeffs" in (tmp_path / "site" / "reference" / "commands" / "datagen.html").read_text(encoding="utf-8")
    # Sphinx takes what precedes a colon in the first line about a property or field for its type.
    assert "Type<span" not in (tmp_path / "site" / "reference" / "python.html").read_text(encoding="utf-8")
    for page in [*tmp_path.glob("site/**/*.html"), *tmp_path.glob("site/**/*.css")]:
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|img|link|iframe|source)\b[^>]*?(?:src|href)=[\"'](?:https?:)?//[^\"']+", text)
        assert not loaded + re.findall(r"(?:url\(|@import )[\"']?(?:https?:)?//", text), page
