"""Damages coefficient files and sees what the reader makes of them: python -m tests.fuzz_mat_files --cases 2000.

Each case cuts a file off or flips some bytes of it. The reader must refuse it with an InputFileError or read it; what
it reads, SciPy reads the same. Nothing may take long or much memory.
"""

import argparse
import io
import json
import tempfile
import tracemalloc
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
import scipy.io

from pix2face.errors import InputFileError
from pix2face.files.mat_files import read_mat

WANTED = ("Shape_Para", "Exp_Para", "Pose_Para", "pt2d", "pt3d_68")


@dataclass(frozen=True)
class FuzzResult:
    """What came out: how many were read, how many refused, and the worst of them."""

    cases: int
    read: int
    refused: int
    slowest_ms: float
    largest_mb: float
    disagreements: tuple[str, ...]


def fuzz(folder: Path, cases: int, seed: int) -> FuzzResult:
    """Runs ``cases`` damaged files through the reader."""
    rng, path = np.random.default_rng(seed), folder / "case.mat"
    originals = [_original(rng, compressed) for compressed in (True, False)]
    n_read, slowest, largest, disagreements = 0, 0.0, 0, []
    tracemalloc.start()
    try:
        for case in range(cases):
            path.write_bytes(_damaged(rng, originals[case % 2]))
            tracemalloc.reset_peak()
            before, start = tracemalloc.get_traced_memory()[0], perf_counter()
            try:
                found = read_mat(path, WANTED)
            except InputFileError:
                found = None
            slowest = max(slowest, perf_counter() - start)
            largest = max(largest, tracemalloc.get_traced_memory()[1] - before)
            if found is not None:
                n_read += 1
                disagreements += _disagreements(found, path, case)
    finally:
        tracemalloc.stop()
    return FuzzResult(cases, n_read, cases - n_read, 1000 * slowest, largest / 2**20, tuple(disagreements))


def _original(rng: np.random.Generator, compressed: bool) -> bytes:
    fields = {
        "pt2d": rng.normal(size=(2, 68)),
        "roi": np.ones((1, 4), np.int16),
        "Tex_Para": rng.normal(size=(199, 1)),
        "Shape_Para": rng.normal(size=(199, 1)) * 1e5,
        "Exp_Para": rng.normal(size=(29, 1)),
        "Pose_Para": rng.normal(size=(1, 7)).astype(np.float32),
        "pt3d_68": rng.normal(size=(3, 68)).astype(np.float32),
    }
    file = io.BytesIO()
    scipy.io.savemat(file, fields, do_compression=compressed)
    return file.getvalue()


def _damaged(rng: np.random.Generator, content: bytes) -> bytes:
    if rng.random() < 0.3:
        return content[: rng.integers(len(content))]
    damaged = bytearray(content)
    # Half of the flips fall where sizes, types and shapes of the first variable stand.
    end = len(content) if rng.random() < 0.5 else 260
    for _ in range(rng.integers(1, 9)):
        damaged[rng.integers(end)] = rng.integers(256)
    return bytes(damaged)


def _disagreements(found: dict[str, np.ndarray], path: Path, case: int) -> list[str]:
    """What SciPy reads otherwise. It fails on other damage than we do; only values that both read count."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            expected = scipy.io.loadmat(path, variable_names=list(found))
    except Exception:  # noqa: BLE001 (SciPy fails in many ways)
        return []
    return [
        f"case {case}: {name}"
        for name, values in found.items()
        if name in expected
        and (values.shape != expected[name].shape or values.tobytes("F") != expected[name].tobytes("F"))
    ]


def main() -> None:
    """Prints the result as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(asdict(fuzz(Path(folder), options.cases, options.seed)), indent=2))  # noqa: T201


if __name__ == "__main__":
    main()
