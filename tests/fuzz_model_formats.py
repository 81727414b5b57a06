"""Damages files of every model format at random and reads them: a case must end soon, in bounds, with one clear error.

    python -m tests.fuzz_model_formats --cases 2000 [--seed 0] [--formats surrey gnm ...]

A case truncates a file, flips bytes, overwrites a few with extreme values, or does several of these. It passes when the
reader returns a model or raises InputFileError. Every format runs in a process of its own with a limit on its memory;
a case that takes too long, a crash and any other exception are failures.
"""

import argparse
import faulthandler
import multiprocessing
import multiprocessing.connection
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import numpy as np

from pix2face.errors import InputFileError
from pix2face.model_formats import read_model
from pix2face.models.model_file import write_stored_model
from pix2face.models.morphable_model import load_model
from tests.model_files import stored_small_head
from tests.published_models import (
    tiny_solid,
    write_bfm,
    write_flame,
    write_gnm,
    write_guo,
    write_ict,
    write_original_bfm,
    write_statismo,
    write_surrey,
)

CASE_LIMIT_S = 5
# Beyond what the interpreter with its libraries has mapped already.
EXTRA_MEMORY_BYTES = 512 << 20
EXTREME_BYTES = (0x00, 0x01, 0x7F, 0x80, 0xFF)


@dataclass(frozen=True)
class Fuzzed:
    """How to write one format and to read it again.

    Attributes:
        write: Fills an empty folder.
        damaged: Names of the files that are damaged, one a case.
        opened: What the reader is given, relative to the folder.
    """

    write: Callable[[Path], object]
    damaged: tuple[str, ...]
    opened: str = "."
    read: Callable[[Path], object] = read_model


def _keypoints() -> np.ndarray:
    return np.arange(68) % 6


FORMATS: dict[str, Fuzzed] = {
    "bfm2009": Fuzzed(
        lambda folder: write_bfm(folder, tiny_solid(), _keypoints()), ("Model_Shape.mat", "Model_Expression.mat")
    ),
    "bfm2009-compressed": Fuzzed(
        lambda folder: write_bfm(folder, tiny_solid(), _keypoints(), compressed=True),
        ("Model_Shape.mat", "Model_Expression.mat"),
    ),
    "bfm2009-original": Fuzzed(
        lambda folder: (
            write_original_bfm(folder, tiny_solid()),
            write_guo(folder, 0 * tiny_solid().mean, tiny_solid().expression),
        ),
        ("01_MorphableModel.mat", "Exp_Pca.bin", "std_exp.txt"),
    ),
    "statismo": Fuzzed(
        lambda folder: write_statismo(
            folder / "a.h5",
            tiny_solid(),
            landmarks='[{"id": "center.nose.tip", "coordinates": [80, 0, 0]}]',
            unit_m=0.001,
        ),
        ("a.h5",),
        "a.h5",
    ),
    "flame": Fuzzed(lambda folder: write_flame(folder / "a.pkl", tiny_solid()), ("a.pkl",), "a.pkl"),
    "flame-protocol-0": Fuzzed(
        lambda folder: write_flame(folder / "a.pkl", tiny_solid(), protocol=0), ("a.pkl",), "a.pkl"
    ),
    "surrey": Fuzzed(
        lambda folder: write_surrey(folder, tiny_solid(), colour=True),
        ("model.bin", "expression_blendshapes.bin"),
        "model.bin",
    ),
    "ict_facekit": Fuzzed(
        lambda folder: write_ict(folder, tiny_solid()),
        ("FaceXModel/generic_neutral_mesh.obj", "FaceXModel/identity000.obj", "FaceXModel/smile1.obj"),
    ),
    "gnm": Fuzzed(lambda folder: write_gnm(folder / "a.npz", tiny_solid()), ("a.npz",), "a.npz"),
    "gnm-compressed": Fuzzed(
        lambda folder: write_gnm(folder / "a.npz", tiny_solid(), compressed=True), ("a.npz",), "a.npz"
    ),
    "pix2face": Fuzzed(
        lambda folder: write_stored_model(stored_small_head(), folder / "a.h5"), ("a.h5",), "a.h5", load_model
    ),
}


class CaseTooSlowError(BaseException):
    """A case passed its time limit; no reader can take this for an error of the file."""


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """One random way to damage a file."""
    data = bytearray(content)
    kind = rng.integers(4)
    if kind in (0, 3):
        # Headers decide most: half of the cuts and flips aim at the first kilobyte.
        reach = len(data) if rng.random() < 0.5 else min(len(data), 1024)
        for _ in range(int(rng.integers(1, 9))):
            data[int(rng.integers(reach))] ^= int(rng.integers(1, 256))
    if kind in (1, 3):
        start = int(rng.integers(len(data)))
        length = int(rng.choice([1, 2, 4, 8]))
        data[start : start + length] = bytes([int(rng.choice(EXTREME_BYTES))]) * len(data[start : start + length])
    if kind in (2, 3):
        del data[int(rng.integers(len(data) + 1)) :]
    return bytes(data)


def run_case(fuzzed: Fuzzed, folder: Path, originals: dict[str, bytes], seed: tuple[int, int]) -> str:
    """Damages one file, reads, and restores it.

    Returns:
        "read", "refused", or what went wrong.
    """
    rng = np.random.default_rng(seed)
    name = fuzzed.damaged[int(rng.integers(len(fuzzed.damaged)))]
    (folder / name).write_bytes(damaged(originals[name], rng))
    signal.setitimer(signal.ITIMER_REAL, CASE_LIMIT_S)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            fuzzed.read(folder / fuzzed.opened)
        return "read"
    except InputFileError as error:
        return "refused" if "\n" not in str(error).strip() else f"several lines: {error}"
    except CaseTooSlowError:
        return f"longer than {CASE_LIMIT_S} s"
    except BaseException as error:  # noqa: BLE001 (whatever it is, it is a finding)
        return f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        (folder / name).write_bytes(originals[name])


def fuzz(name: str, cases: int, seed: int, first: int = 0) -> Counter[str]:
    """Runs cases of one format in this process, without a limit on memory."""
    fuzzed, outcomes = FORMATS[name], Counter[str]()
    signal.signal(signal.SIGALRM, _too_slow)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        fuzzed.write(folder)
        originals = {file: (folder / file).read_bytes() for file in fuzzed.damaged}
        fuzzed.read(folder / fuzzed.opened)  # undamaged, it must be read
        for case in range(first, first + cases):
            outcome = run_case(fuzzed, folder, originals, (seed, case))
            outcomes[outcome if outcome in ("read", "refused") else f"case {case}: {outcome}"] += 1
    return outcomes


def main() -> int:
    """Fuzzes formats, each in a limited process of its own, and prints what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--formats", nargs="*", default=list(FORMATS), choices=list(FORMATS))
    options = parser.parse_args()
    return run_formats(options.formats, options.cases, options.seed)


def run_formats(names: Sequence[str], cases: int, seed: int) -> int:
    """Fuzzes formats of the table, prints what came of it, and returns the exit status."""
    n_failed = 0
    for name in names:
        started = time.monotonic()
        receiver, sender = multiprocessing.Pipe(duplex=False)
        process = multiprocessing.get_context("fork").Process(target=_limited, args=(name, cases, seed, sender))
        process.start()
        sender.close()
        try:
            outcomes = receiver.recv()
        except EOFError:
            outcomes = Counter({f"the process died with status {process.exitcode}": 1})
        process.join()
        failures = {what: n for what, n in outcomes.items() if what not in ("read", "refused")}
        n_failed += len(failures)
        print(  # noqa: T201
            f"{name}: {cases} cases, {outcomes['refused']} refused, {outcomes['read']} read, "
            f"{len(failures)} failed, {time.monotonic() - started:.0f} s",
            flush=True,
        )
        for what in list(failures)[:5]:
            print(f"  {what}", flush=True)  # noqa: T201
    return int(n_failed > 0)


def _limited(name: str, cases: int, seed: int, sender: multiprocessing.connection.Connection) -> None:
    faulthandler.enable()
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + EXTRA_MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    sender.send(fuzz(name, cases, seed))


def _too_slow(signal_number: int, frame: FrameType | None) -> None:
    raise CaseTooSlowError


if __name__ == "__main__":
    sys.exit(main())
