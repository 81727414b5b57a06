"""Start-up of every command, and one photograph: python -m tests.benchmarks.starting [--tree DIR] [--out FILE].

``--help`` of each command runs in a process of its own. The figure is the time of the processor, the least of several
runs after one that is not counted. ``photograph`` is what the commands take for scikit-image's astronaut, by the clock
and of the processor, and the files that they write; ``--no-photograph`` leaves it out. ``--tree`` takes the programs
from another copy of the project, to compare two of them.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from skimage import data

from tests.benchmarks.measuring import options_parser, write_report
from tests.test_help import PAGES, PROGRAMS

ROOT = Path(__file__).parents[2]
PHOTOGRAPH = Path(data.__file__).parent / "astronaut.png"
CALLS = ("pix2face fit", "pix2face predict", "pix2face view")


def command(call: str) -> list[str]:
    program, *words = call.split()
    return [sys.executable, "-m", PROGRAMS[program].__module__, *words]


def times_of(run: list[str], tree: Path, rounds: int) -> tuple[float, float] | None:
    """Least time by the clock and of the processor, seconds; None if the run fails."""
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    clock, processor = [], []
    for _ in range(rounds + 1):
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run(run, cwd=tree, env=environment, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            return None
        clock.append(time.perf_counter() - began)
        processor.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return round(min(clock[1:]), 3), round(min(processor[1:]), 3)


def start_up_s(call: str, tree: Path, rounds: int) -> float | None:
    """Processor time of a help page; None if the command does not exist in this tree."""
    found = times_of([*command(call), "--help"], tree, rounds)
    return None if found is None else found[1]


def of_photograph(call: str, tree: Path, rounds: int) -> dict[str, object]:
    """What a command takes for one photograph, and the bytes of each file that it writes."""
    with tempfile.TemporaryDirectory() as name:
        target = Path(name) / "page.html" if call.endswith("view") else Path(name)
        found = times_of([*command(call), str(PHOTOGRAPH), "--out", str(target)], tree, rounds)
        assert found is not None, call
        sizes = {path.name: path.stat().st_size for path in sorted(Path(name).iterdir())}
    return {"clock_s": found[0], "processor_s": found[1], "file_bytes": sizes}


def main() -> None:
    """Runs the benchmark."""
    parser = options_parser(__doc__)
    parser.add_argument("--tree", type=Path, default=ROOT, help="copy of the project that is measured")
    parser.add_argument("--rounds", type=int, default=3, help="runs of each command")
    parser.add_argument("--calls", nargs="+", default=PAGES, metavar="CALL", help="commands, such as 'pix2face fit'")
    parser.add_argument("--no-photograph", action="store_true", help="measure start-up alone")
    arguments = parser.parse_args()
    tree = arguments.tree.resolve()
    report: dict[str, object] = {
        "start_up_processor_s": {call: start_up_s(call, tree, arguments.rounds) for call in arguments.calls},
    }
    if not arguments.no_photograph:
        report["photograph"] = {call: of_photograph(call, tree, arguments.rounds) for call in CALLS}
    write_report(report, arguments.out)


if __name__ == "__main__":
    main()
