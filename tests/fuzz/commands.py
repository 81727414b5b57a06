"""Runs commands on the hostile and troublesome files at hand, with the limits that readers are fuzzed with.

    python -m tests.fuzz.commands ../shared OUT

Prints what came of each, and ends with status 1 where a command crashed, passed a limit, or returned another exit
status than 0, 2 or 3.
"""

import json
import shutil
import sys
import tarfile
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from itertools import count
from pathlib import Path

import datagen.cli
from pix2face.errors import InputFileError
from pix2face.files.images import read_photograph
from tests.fuzz.limits import Case, run_cases

# What is given to each file or folder of a kind; {path} is a copy of it, {out} is a path without an ending.
COMMANDS = {
    "hostile/gnm/*": ["model import {path} --out {out}.h5"],
    "hostile/pickle/*": ["model import {path} --out {out}.h5"],
    "hostile/shard/*": ["verify {path}", "stats {path}", "card {path}", "preview {path}"],
    "hostile/table/*": ["coeffs info {path}"],
    "hostile/xml/*": ["fit --landmarks {path}/list.xml --out {out}.h5 --workers 1"],
    "trouble/exif": ["fit --landmarks {path} --out {out}.h5 --workers 1"],
    "trouble/onlyupper": ["fit --landmarks {path} --out {out}.h5 --workers 1"],
    "trouble/pts": ["fit --landmarks {path} --out {out}.h5 --workers 1"],
    "trouble/pts_variants": ["fit --landmarks {path} --out {out}.h5 --workers 1"],
    "trouble/*.mat": ["coeffs convert --from {path} --out {out}.h5 --workers 1"],
    "trouble/*.bin": ["model import {path} --out {out}.h5"],
    "trouble/*.tgz": ["verify {path}", "stats {path}"],
}
PICTURES = ("*.jpg", "*.png", "*.tiff", "*.heic")


def cases(shared: Path, folder: Path) -> Iterator[tuple[str, Case]]:
    """A name and a call for each file and command."""
    numbers = count()
    for pattern, commands in COMMANDS.items():
        for source in sorted(shared.glob(pattern)):
            for command in commands:
                out = folder / f"out{next(numbers)}"
                words = command.format(path=copied(source, folder / f"in{next(numbers)}"), out=out).split()
                yield f"{command.partition(' {')[0]}: {source.relative_to(shared)}", partial(run, words)
    for pattern in PICTURES:
        for source in sorted((shared / "trouble").glob(pattern)):
            yield f"read_photograph: {source.name}", partial(read_photograph, source)


def copied(source: Path, folder: Path) -> Path:
    """A copy that commands may write beside: of a folder, an archive's content, a picture's annotation, or a file."""
    if source.is_dir():
        return shutil.copytree(source, folder, copy_function=shutil.copyfile)
    folder.mkdir()
    if source.suffix == ".tgz":
        with tarfile.open(source) as archive:
            archive.extractall(folder, filter="data")
        return next(folder.rglob("shard-*.h5")).parent
    beside = [source, *source.parent.glob(f"{source.stem}.jpg")] if source.suffix == ".mat" else [source]
    for path in beside:
        shutil.copyfile(path, folder / path.name)
    return folder if source.suffix == ".mat" else folder / source.name


def run(words: list[str]) -> None:
    """Runs a command of ``datagen``; a refusal is raised as readers do."""
    status = datagen.cli.main(words)
    if status in (2, 3):
        raise InputFileError(f"exit status {status}")
    assert status == 0, status


def main(shared: Path, folder: Path) -> int:
    """Runs all commands and prints what came of each, a line of JSON for each."""
    names, calls = zip(*cases(shared, folder), strict=True)
    n_failed = 0
    for name, outcome in zip(names, run_cases(calls), strict=True):
        print(json.dumps({"name": name, **asdict(outcome)}), flush=True)  # noqa: T201
        n_failed += outcome.is_failure
    return int(n_failed > 0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
