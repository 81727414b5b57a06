"""Draws files from the grammar of each reader and reads them, with limits on time, memory and open files.

    python -m tests.fuzz [--cases 5000] [--seed 0] [--readers pts xml ...]

Prints for each reader how many files were read and refused, the longest time and the most memory, and what failed.
"""

import argparse
import shutil
import sys
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from tests.fuzz.binary_grammars import BINARY_GRAMMARS
from tests.fuzz.damaged_grammars import DAMAGED_GRAMMARS
from tests.fuzz.grammar import Grammar
from tests.fuzz.limits import Outcome, run_cases
from tests.fuzz.no_files import no_files
from tests.fuzz.text_grammars import TEXT_GRAMMARS

GRAMMARS: dict[str, Grammar] = {**TEXT_GRAMMARS, **BINARY_GRAMMARS, **DAMAGED_GRAMMARS}
NO_FILES = "no files"
BATCH = 500  # files that stand on the disk at the same time


def read_drawn(grammar: Grammar, folder: Path, seed: int, numbers: range) -> list[Outcome]:
    """Writes cases and reads them, in a process for each.

    Libraries may keep what they have written in mind, and stumble over it later, or end the process while they write
    what no program would ask them for. Such a case is left out.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    paths = [folder / f"case{number}{grammar.suffix}" for number in numbers]
    draws = [
        partial(grammar.write, path, np.random.default_rng((seed, number)))
        for path, number in zip(paths, numbers, strict=True)
    ]
    written = [path for path, outcome in zip(paths, run_cases(draws), strict=True) if not outcome.is_failure]
    outcomes = run_cases([partial(grammar.read, path) for path in written])
    return [replace(outcome, case=int(path.stem[4:])) for path, outcome in zip(written, outcomes, strict=True)]


def report(name: str, outcomes: list[Outcome], seconds: float) -> int:
    """Prints how the cases of a reader ended, and returns how many failed."""
    failed = [outcome for outcome in outcomes if outcome.is_failure]
    n_read, n_refused = (sum(outcome.verdict == verdict for outcome in outcomes) for verdict in ("read", "refused"))
    print(  # noqa: T201
        f"{name}: {len(outcomes)} cases, {n_read} read, {n_refused} refused, {len(failed)} failed; "
        f"at most {max(outcome.seconds for outcome in outcomes):.2f} s and "
        f"{max(outcome.peak_mb for outcome in outcomes):.0f} MB; {seconds:.1f} s",
        flush=True,
    )
    for outcome in failed[:5]:
        print(f"  case {outcome.case}: {outcome.verdict}", flush=True)  # noqa: T201
    return len(failed)


def main() -> int:
    """Runs the grammars of the readers asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--readers", nargs="*", default=[*GRAMMARS, NO_FILES], choices=[*GRAMMARS, NO_FILES])
    options = parser.parse_args()
    n_failed = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "cases"
        for name in options.readers:
            start = perf_counter()
            if name == NO_FILES:
                outcomes = list(run_cases(no_files(Path(temporary), GRAMMARS)))
            else:
                batches = (range(first, min(first + BATCH, options.cases)) for first in range(0, options.cases, BATCH))
                outcomes = [
                    outcome
                    for numbers in batches
                    for outcome in read_drawn(GRAMMARS[name], folder, options.seed, numbers)
                ]
            n_failed += report(name, outcomes, perf_counter() - start)
    return int(n_failed > 0)


if __name__ == "__main__":
    sys.exit(main())
