"""The tree stays readable: few modules in a folder, a name for one thing only, no module of a few lines."""

from collections import Counter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("pix2face", "datagen", "training")
MOST_MODULES = 12
LEAST_LINES = 20
# Each program has one.
SHARED_NAMES = {"cli.py"}


def modules() -> list[Path]:
    found = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    assert len(found) > 200
    return [path for path in found if path.name != "__init__.py"]


def test_no_folder_has_more_than_a_dozen_modules() -> None:
    counts = Counter(path.parent.relative_to(ROOT).as_posix() for path in modules())
    assert {folder: n for folder, n in counts.items() if n > MOST_MODULES} == {}


def test_no_name_stands_for_two_modules() -> None:
    counts = Counter(path.name for path in modules())
    assert {name for name, n in counts.items() if n > 1} - SHARED_NAMES == set()


def test_no_module_is_a_few_lines() -> None:
    assert [path for path in modules() if path.read_text(encoding="utf-8").count("\n") < LEAST_LINES] == []


@pytest.mark.parametrize("package", PACKAGES)
def test_every_folder_says_what_it_holds(package: str) -> None:
    for init in (ROOT / package).rglob("__init__.py"):
        assert init.read_text(encoding="utf-8").startswith('"""'), init


@pytest.mark.parametrize(("package", "most"), [("pix2face", 101), ("training", 55)])
def test_few_arrows_lead_from_room_to_room(package: str, most: int) -> None:
    """Rooms are the folders and modules right below a package; circles among them are for the import contracts."""
    graph = grimp.build_graph(package)
    for room in graph.find_children(package):
        if graph.find_children(room):
            graph.squash_module(room)
    rooms = graph.find_children(package)
    arrows = sum(len(graph.find_modules_directly_imported_by(room) - {package}) for room in rooms)
    assert len(rooms) <= arrows <= most
