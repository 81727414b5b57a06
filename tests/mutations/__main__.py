"""Puts each mistake into a copy of the repository and runs the tests that have to notice it.

    python -m tests.mutations                  all of them: some minutes
    python -m tests.mutations crop             those whose name contains "crop"

Prints a line a mistake and JSON at the end; the exit status is 1 where one survives. Research data are not used.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.mutations.mistakes import MISTAKES, Mistake

ROOT = Path(__file__).parents[2]
LONGEST_S = 600


def place_of(mistake: Mistake, root: Path = ROOT) -> Path:
    """The one file whose text a mistake replaces.

    Raises:
        LookupError: The text occurs nowhere, or more than once.
    """
    found = [
        path for path in sorted((root / mistake.folder).rglob("*.py")) for _ in range(_count(path, mistake.before))
    ]
    if len(found) != 1:
        raise LookupError(f"{mistake.name}: expected {mistake.before!r} once in {mistake.folder}, found {len(found)}")
    return found[0]


def survives(mistake: Mistake, root: Path) -> bool:
    """Whether the tests pass with a mistake in a copy of the repository."""
    path = place_of(mistake, root)
    right = path.read_text(encoding="utf-8")
    path.write_text(right.replace(mistake.before, mistake.after), encoding="utf-8")
    try:
        return run_tests(root, mistake.tests) == 0
    finally:
        path.write_text(right, encoding="utf-8")


def run_tests(root: Path, tests: str) -> int:
    """The exit status of some tests; 1 where they take too long, as with a loop that no longer ends."""
    environment = {**os.environ, "PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.setdefault("OPENBLAS_NUM_THREADS", "1")
    environment.setdefault("OMP_NUM_THREADS", "1")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", tests]
    try:
        done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        return 1
    if done.returncode not in (0, 1):  # pytest's own troubles prove nothing
        raise RuntimeError(f"{tests}: pytest ended with {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.returncode


def main(argv: list[str]) -> int:
    """Tries the mistakes; returns the exit status."""
    chosen = [mistake for mistake in MISTAKES if not argv or any(word in mistake.name for word in argv)]
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        root = Path(folder) / "repository"
        _copy(root)
        for tests in sorted({mistake.tests for mistake in chosen}):
            if run_tests(root, tests) != 0:
                raise SystemExit(
                    f"{tests} fails without any mistake, or takes more than {LONGEST_S} s: mend that first"
                )
        survivors = []
        for mistake in chosen:
            started = time.perf_counter()
            has_survived = survives(mistake, root)
            if has_survived:
                survivors.append(mistake.name)
            verdict = "SURVIVED" if has_survived else "noticed"
            print(f"{verdict}  {mistake.name} ({time.perf_counter() - started:.0f} s)", flush=True)
    print(json.dumps({"mistakes": len(chosen), "survivors": survivors}, indent=1))
    return 1 if survivors else 0


def _count(path: Path, text: str) -> int:
    return path.read_text(encoding="utf-8").count(text)


def _copy(root: Path) -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, root / name)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
