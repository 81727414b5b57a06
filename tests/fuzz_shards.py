"""Damages shards and tables of coefficients at random and reads them: a case ends soon, with one clear error or none.

    python -m tests.fuzz_shards --cases 2000 [--seed 0] [--formats shard table ...]

As tests.fuzz_model_formats, which has the ways to damage a file. A damaged shard may also be read without an error, or
be listed as damaged by ``verify_shard``; what must not happen is a crash, another exception, or memory without bounds.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from pix2face.errors import InputFileError
from pix2face.face_files.coefficients import FaceCoefficients, load_coefficients, save_coefficients
from pix2face.shards.shard_checks import verify_shard
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.fuzz_model_formats import FORMATS, Fuzzed, run_formats
from tests.pix2face.shard_files import as_earlier_versions_stored, every_layer


def write_small_shard(folder: Path, kind: str) -> None:
    """Every layer, four samples."""
    write_shard(folder / "shard-00000.h5", *every_layer(4), is_plain=kind == "plain")
    if kind.startswith("old-"):
        as_earlier_versions_stored(folder / "shard-00000.h5", kind.removeprefix("old-"))


def read_shard(path: Path) -> None:
    """Everything that readers of shards do with one."""
    problems = verify_shard(path)
    reader = ShardReader(path)
    for index in range(len(reader)):
        try:
            reader.stored(index, reader.header.layers[:-1], is_checked=True)
            _ = reader.read(index).image
        except InputFileError:
            continue
    if problems:
        raise InputFileError(problems[0])


def write_table(folder: Path) -> None:
    """Some faces with all that a table can have."""
    rng = np.random.default_rng(0)
    table = FaceCoefficients(
        model_name="synthetic",
        model_sha256="0" * 64,
        sample_ids=tuple(f"face/{index}" for index in range(9)),
        identity=rng.normal(size=(9, 12)).astype(np.float32),
        expression=rng.normal(size=(9, 6)).astype(np.float32),
        cameras=rng.normal(size=(9, 4, 4)),
        sizes_px=rng.integers(1, 500, size=(9, 2)).astype(np.int32),
        image_paths=tuple("" if index % 2 else f"pictures/{index}.jpg" for index in range(9)),
        attributes=('{"source": "test", "yaw_deg": 3.5}',) * 9,
        lighting=rng.normal(size=(9, 10)).astype(np.float32),
        rejected=(("bad", "no picture"),),
    )
    save_coefficients(table, folder / "faces.h5")


def fuzzed_shard(kind: str) -> Fuzzed:
    """A shard of one kind."""
    return Fuzzed(lambda folder: write_small_shard(folder, kind), ("shard-00000.h5",), "shard-00000.h5", read_shard)


SHARDS_AND_TABLES: dict[str, Fuzzed] = {
    "shard": fuzzed_shard("coded"),
    "shard-plain": fuzzed_shard("plain"),
    "shard-2": fuzzed_shard("old-deflate"),
    "shard-2-plain": fuzzed_shard("old-plain"),
    "shard-2-zstd": fuzzed_shard("old-zstd"),
    "table": Fuzzed(write_table, ("faces.h5",), "faces.h5", load_coefficients),
}
FORMATS.update(SHARDS_AND_TABLES)


def main() -> int:
    """Fuzzes shards and tables, each in a limited process of its own, and prints what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--formats", nargs="*", default=list(SHARDS_AND_TABLES), choices=list(SHARDS_AND_TABLES))
    options = parser.parse_args()
    return run_formats(options.formats, options.cases, options.seed)


if __name__ == "__main__":
    sys.exit(main())
