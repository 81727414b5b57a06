"""A share of what ``python -m tests.fuzz`` does at length, and the hostile files at hand."""

import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from pix2face.errors import Pix2FaceError
from pix2face.face_files.annotations import read_dlib_xml
from pix2face.face_files.coefficients import load_coefficients
from pix2face.model_formats import read_model
from pix2face.shards.shard_reader import ShardReader
from tests.fuzz.limits import run_cases

ROOT = Path(__file__).parents[2]
CASES = 500


def test_files_drawn_from_grammars_are_read_or_refused() -> None:
    """In processes of their own, with limits on time, memory and open files."""
    command = [sys.executable, "-m", "tests.fuzz", "--cases", str(CASES)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 23
    assert all(" 0 failed" in line for line in lines)
    assert sum(f" {CASES} cases, 0 read" in line for line in lines) < 3  # most grammars also make files that are right


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


def test_the_hostile_files_at_hand_are_refused(shared_dir: Path) -> None:
    folder = shared_dir / "hostile"
    read: dict[str, Callable[[Path], object]] = {
        "gnm/*": read_model,
        "pickle/*": read_model,
        "shard/*/*.h5": ShardReader,
        "table/*": load_coefficients,
        "xml/*/*.xml": read_dlib_xml,
    }
    paths = [(path, own) for pattern, own in read.items() for path in sorted(folder.glob(pattern))]
    if not paths:
        pytest.skip(f"no files in {folder}")
    outcomes = run_cases([partial(own, path) for path, own in paths])
    verdicts = {
        path.relative_to(folder).as_posix(): outcome for (path, _), outcome in zip(paths, outcomes, strict=True)
    }
    assert not [name for name, outcome in verdicts.items() if outcome.is_failure]
    assert {name for name, outcome in verdicts.items() if outcome.verdict == "read"} <= {
        "shard/bignum/shard-999999999999.h5",  # `datagen verify` says what is missing
        "shard/h_cfg_huge/shard-00000.h5",
        "table/at_expr.h5",
        "table/rej_redos.h5",
    }
