"""Draws files from the grammar of each reader and reads them, with limits on time, memory and open files.

    python -m tests.fuzz [--cases 5000] [--seed 0] [--readers pts xml ...]

Prints for each reader how many files were read and refused, the longest time and the most memory, and what failed.
"""

import argparse
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

from tests.fuzz.binary_grammars import BINARY_GRAMMARS
from tests.fuzz.grammar import Grammar
from tests.fuzz.limits import Case, run_cases
from tests.fuzz.no_files import no_files
from tests.fuzz.text_grammars import TEXT_GRAMMARS

GRAMMARS: dict[str, Grammar] = {**TEXT_GRAMMARS, **BINARY_GRAMMARS}
NO_FILES = "no files"


def drawn(grammar: Grammar, path: Path, seed: int, case: int) -> Case:
    """Writes a case, and reads it."""
    path = path.with_stem(f"case{case % 2}")  # not the file of the case before, which a library may still know
    return lambda: grammar.write(path, np.random.default_rng((seed, case))), lambda: grammar.read(path)


def report(name: str, cases: list[Case]) -> int:
    """Runs cases, prints what came of them, and returns how many failed."""
    start = perf_counter()
    outcomes = list(run_cases(cases))
    failed = [outcome for outcome in outcomes if outcome.is_failure]
    n_read, n_refused = (sum(outcome.verdict == verdict for outcome in outcomes) for verdict in ("read", "refused"))
    print(  # noqa: T201
        f"{name}: {len(cases)} cases, {n_read} read, {n_refused} refused, {len(failed)} "
        "failed; "
        f"at most {max(outcome.seconds for outcome in outcomes):.2f} s and "
        f"{max(outcome.peak_mb for outcome in outcomes):.0f} MB; {perf_counter() - start:.1f} s",
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
        for name in options.readers:
            folder = Path(temporary) / name.replace(" ", "_")
            folder.mkdir()
            if name == NO_FILES:
                n_failed += report(name, no_files(folder, GRAMMARS))
                continue
            path = folder / f"case{GRAMMARS[name].suffix}"
            cases = [drawn(GRAMMARS[name], path, options.seed, case) for case in range(options.cases)]
            n_failed += report(name, cases)
    return int(n_failed > 0)


if __name__ == "__main__":
    sys.exit(main())
