"""A share of what ``python -m tests.fuzz`` does at length, and the hostile files at hand."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pix2face.errors import Pix2FaceError
from tests.fuzz.__main__ import NO_FILES
from tests.fuzz.binary_grammars import BINARY_GRAMMARS
from tests.fuzz.damaged_grammars import DAMAGED_GRAMMARS
from tests.fuzz.limits import run_cases
from tests.fuzz.text_grammars import TEXT_GRAMMARS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("readers", "cases"), [((*TEXT_GRAMMARS, *BINARY_GRAMMARS, NO_FILES), 75), (tuple(DAMAGED_GRAMMARS), 20)]
)
def test_files_drawn_from_grammars_are_read_or_refused(readers: tuple[str, ...], cases: int) -> None:
    """In processes of their own, with limits on time, memory and open files."""
    command = [sys.executable, "-m", "tests.fuzz", "--cases", str(cases), "--readers", *readers]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == len(readers)
    assert all(" 0 failed" in line for line in lines)
    assert not any(" 0 refused" in line for line in lines)
    assert sum(f" {cases} cases, 0 read" in line for line in lines) < 3  # most grammars also make files that are right


def grown() -> None:
    _ = bytearray(2 << 30)


def left_open() -> None:
    _KEPT.append(open(__file__))  # noqa: PTH123, SIM115


def too_long() -> None:
    raise Pix2FaceError("x" * 10_000)


def endless() -> None:
    while True:
        pass


_KEPT: list[object] = []


@pytest.mark.parametrize(
    ("read", "verdict"),
    [
        (grown, "MemoryError"),
        (left_open, "1 files left open"),
        (too_long, "refused"),
        (endless, "longer than"),
        (exit, "SystemExit"),
    ],
)
def test_limits_can_fail(monkeypatch: pytest.MonkeyPatch, read: Callable[[], object], verdict: str) -> None:
    monkeypatch.setattr("tests.fuzz.limits.LONGEST_S", 0.2)
    bad, good = run_cases([read, lambda: None])
    assert bad.verdict.startswith(verdict)
    assert good.verdict == "read"


def test_commands_end_well_on_the_hostile_files_at_hand(shared_dir: Path, tmp_path: Path) -> None:
    """In a process of its own: the checks of types that tests run with make a million small calls slow."""
    if not (shared_dir / "hostile").is_dir() or not (shared_dir / "trouble").is_dir():
        pytest.skip(f"no hostile files in {shared_dir}")
    command = [sys.executable, "-m", "tests.fuzz.commands", str(shared_dir), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    found = {line["name"]: line["verdict"] for line in map(json.loads, done.stdout.splitlines())}
    assert found["coeffs info: hostile/table/sv_inf.h5"] == "refused"
    assert found["verify: hostile/shard/lm_67"] == "refused"
    assert found["read_photograph: pano108mp.jpg"] == "read"
