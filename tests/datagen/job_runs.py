"""Small jobs of ``datagen render``: in processes of their own, for tests that interrupt them, or in this one."""

import contextlib
import io
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from datagen.cli import main
from datagen.sampling.faces import sample_faces
from pix2face.face_files.coefficients import save_coefficients
from pix2face.models.morphable_model import load_model
from tests.model_files import write_small_head

ROOT = Path(__file__).parents[2]
N_FACES, SHARD_SIZE, SIZE_PX = 40, 4, 48
N_SHARDS = N_FACES // SHARD_SIZE
PROGRAM = "import sys; from datagen.cli import main; sys.exit(main(sys.argv[1:]))"


@dataclass(frozen=True)
class Inputs:
    """A model and a table of faces: rendered pictures, photographs, and one that is missing."""

    folder: Path

    def command(self, out: Path, *options: object) -> list[str]:
        arguments = ["--coeffs", self.folder / "faces.h5", "--model", self.folder / "model.h5", "--out", out]
        fixed = ["--shard-size", SHARD_SIZE, "--max-rejected", 1]
        return [sys.executable, "-c", PROGRAM, "render", *map(str, (*arguments, *fixed, *options))]

    def start(self, out: Path, *options: object, workers: int = 2) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            self.command(out, "--workers", workers, *options),
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )

    def run(self, out: Path, *options: object, workers: int = 1) -> str:
        """Runs to the end in this process, which must be a good one; what it said."""
        with contextlib.redirect_stderr(io.StringIO()) as said:
            status = main(self.command(out, "--workers", workers, *options)[3:])
        assert status == 0, said.getvalue()
        return said.getvalue()


def make_inputs(folder: Path) -> Inputs:
    model = load_model(write_small_head(folder / "model.h5"))
    table = sample_faces(model, N_FACES, 0, SIZE_PX)
    image = np.random.default_rng(0).integers(0, 256, (SIZE_PX, SIZE_PX, 3), dtype=np.uint8)
    cv2.imwrite(str(folder / "photograph.jpg"), image)
    paths = ["photograph.jpg" if index % 2 else "" for index in range(N_FACES)]
    paths[9] = "missing.jpg"
    save_coefficients(replace(table, image_paths=tuple(paths)), folder / "faces.h5")
    return Inputs(folder)


def content(out: Path) -> dict[str, bytes]:
    """Every file of a folder, hidden ones included."""
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in out.rglob("*") if path.is_file()}


def changed(before: dict[str, bytes], now: dict[str, bytes]) -> list[str]:
    """The names of files that are gone or differ; a comparison of contents would print them all."""
    return [name for name in before if before[name] != now.get(name)]


def differing(out: Path, expected: dict[str, bytes]) -> list[str]:
    """The names of files that only one side has, or that differ."""
    found = content(out)
    return sorted({*changed(found, expected), *changed(expected, found)})


def finished_shards(out: Path) -> list[Path]:
    return sorted(out.glob("shard-*.h5"))


def wait_for_shards(out: Path, n: int, process: "subprocess.Popen[str]", timeout_s: float = 60) -> None:
    """Until so many shards are finished; the job must not have ended before."""
    deadline = time.monotonic() + timeout_s
    while len(finished_shards(out)) < n:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline, f"{len(finished_shards(out))} shards after {timeout_s} s"
        time.sleep(0.005)


def workers_of(process: "subprocess.Popen[str]") -> list[int]:
    """The processes of a job's pool: its children but the tracker of resources."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(pid) for pid in children if "resource_tracker" not in Path(f"/proc/{pid}/cmdline").read_text()]


def kill(process: "subprocess.Popen[str]") -> None:
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)


def is_alive(pid: int) -> bool:
    """Whether a process runs: one that has ended and is not yet waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until_dead(pids: list[int], timeout_s: float = 20) -> None:
    deadline = time.monotonic() + timeout_s
    while alive := [pid for pid in pids if is_alive(pid)]:
        assert time.monotonic() < deadline, f"{alive} still run"
        time.sleep(0.01)
