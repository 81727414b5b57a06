"""Start-up of every command and size of its files: python -m tests.benchmarks.starting [--tree DIR] [--out FILE].

``--help`` of each command runs in a process of its own. The figure is the time of the processor, the least of several
runs after one that is not counted. The files are those that the commands write for the photograph of the documentation;
``--no-files`` leaves them out. ``--tree`` takes the programs from another copy of the project, to compare two of them.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.benchmarks.surroundings import surroundings, write_report
from tests.test_help import PAGES, PROGRAMS

ROOT = Path(__file__).parents[2]
PHOTOGRAPH = ROOT / "docs" / "images" / "astronaut.jpg"
CALLS = {
    "pix2face fit": ["--mesh", "obj,ply,glb"],
    "pix2face predict": ["--format", "npz,png16,exr"],
    "pix2face view": [],
}


def command(call: str) -> list[str]:
    program, *words = call.split()
    return [sys.executable, "-m", PROGRAMS[program].__module__, *words]


def start_up_s(call: str, tree: Path, rounds: int) -> float | None:
    """Processor time of a help page; None if the command does not exist in this tree."""
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    times = []
    for _ in range(rounds + 1):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([*command(call), "--help"], cwd=tree, env=environment, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            return None
        times.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return round(min(times[1:]), 3)


def file_sizes(tree: Path) -> dict[str, dict[str, int]]:
    """Bytes of each file that the commands write for one photograph."""
    sizes = {}
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    for call, options in CALLS.items():
        with tempfile.TemporaryDirectory() as name:
            target = Path(name) / "page.html" if call.endswith("view") else Path(name)
            run = [*command(call), str(PHOTOGRAPH), "--out", str(target), *options]
            subprocess.run(run, cwd=tree, env=environment, check=True, capture_output=True)
            sizes[call] = {path.name: path.stat().st_size for path in sorted(Path(name).iterdir())}
    return sizes


def main() -> int:
    """Runs the benchmark."""
    parser = argparse.ArgumentParser(description="Start-up of every command, and size of the files of a photograph.")
    parser.add_argument("--tree", type=Path, default=ROOT, help="copy of the project that is measured")
    parser.add_argument("--rounds", type=int, default=3, help="runs of each command")
    parser.add_argument("--calls", nargs="+", default=PAGES, metavar="CALL", help="commands, such as 'pix2face fit'")
    parser.add_argument("--no-files", action="store_true", help="measure start-up alone")
    parser.add_argument("--out", type=Path, help="also write the report to this file")
    arguments = parser.parse_args()
    tree = arguments.tree.resolve()
    report = {
        **surroundings(),
        "start_up_cpu_s": {call: start_up_s(call, tree, arguments.rounds) for call in arguments.calls},
        **({} if arguments.no_files else {"file_bytes": file_sizes(tree)}),
    }
    write_report(report, arguments.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
