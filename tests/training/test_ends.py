"""``train`` ends by itself whatever fails, with one line and its exit status; and it works without ``/dev/shm``."""

import errno
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py
import pytest

from training.cli import main

PATIENCE_SECONDS = 60
ORPHANS_END_SECONDS = 5
SMALL = ["--preset", "tiny", "--size-px", "32", "--filters", "4", "--batch-size", "4", "--device", "cpu"]


def options(shards: Path, out: Path, *more: str) -> list[str]:
    return ["--shards", str(shards), "--out", str(out), *SMALL, *more]


def start(arguments: list[str], *before: str) -> subprocess.Popen[str]:
    command = [*before, sys.executable, "-m", "training.cli", *arguments]
    return subprocess.Popen(
        command, env={**os.environ, "OMP_NUM_THREADS": "1"}, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def end_of(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit status and last line, of a process that ends by itself and leaves none behind."""
    try:
        _, said = process.communicate(timeout=PATIENCE_SECONDS)
        until = time.monotonic() + ORPHANS_END_SECONDS
        with suppress(ProcessLookupError):
            while time.monotonic() < until:
                os.killpg(process.pid, 0)
                time.sleep(0.02)
            pytest.fail(f"processes are left behind: {said}")
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert "Traceback" not in said, said
    return process.returncode, said.splitlines()[-1]


def children_of(process: subprocess.Popen[str]) -> list[int]:
    found = []
    for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
        with suppress(OSError):  # it has ended meanwhile
            if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes():
                found.append(int(pid))
    return found


@contextmanager
def files_of_at_most(n_bytes: int) -> Iterator[None]:
    """A full disk, as far as programs can tell: each write beyond a file's first bytes fails."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_damaged_sample_ends_it_with_workers(shards_dir: Path, tmp_path: Path) -> None:
    shutil.copytree(shards_dir, tmp_path / "shards")
    path = tmp_path / "shards" / "shard-000001.h5"
    with h5py.File(path, "r") as file:
        offset = file["pncc"].id.get_chunk_info(1).byte_offset
    content = bytearray(path.read_bytes())
    content[offset + 40] ^= 0xFF
    path.write_bytes(content)
    status, line = end_of(start(options(tmp_path / "shards", tmp_path / "run", "--workers", "2")))
    assert status == 2
    assert line.startswith(f"train: error: {path}: sample 'head-004' is damaged")


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="workers are found in /proc, which only Linux has")
def test_a_killed_worker_ends_it(shards_dir: Path, tmp_path: Path) -> None:
    process = start(options(shards_dir, tmp_path / "run", "--workers", "2"))
    began = time.monotonic()
    while len(workers := children_of(process)) < 2:
        assert process.poll() is None
        assert time.monotonic() - began < PATIENCE_SECONDS
        time.sleep(0.05)
    os.kill(workers[0], signal.SIGKILL)
    status, line = end_of(process)
    assert status == 2
    assert "a process that loads samples ended unexpectedly (signal 9)" in line


NO_SHARED_MEMORY = {"none": "mount -t tmpfs -o ro none /dev/shm", "small": "mount -t tmpfs -o size=64k none /dev/shm"}


@pytest.mark.parametrize("kind", NO_SHARED_MEMORY)
def test_it_needs_no_shared_memory(kind: str, shards_dir: Path, tmp_path: Path) -> None:
    inside = ["unshare", "--map-root-user", "--mount", "sh", "-c", f'{NO_SHARED_MEMORY[kind]} && exec "$@"', "sh"]
    if shutil.which("unshare") is None or subprocess.run([*inside, "true"], capture_output=True).returncode:
        pytest.skip("this machine does not let a test mount a /dev/shm of its own")
    arguments = options(shards_dir, tmp_path / "run", "--workers", "1", "--epochs", "1", "--epoch-size", "8")
    status, line = end_of(start(arguments, *inside))
    assert status == 0, line
    assert (tmp_path / "run" / "checkpoint.safetensors").exists()


@pytest.mark.parametrize(
    ("more", "n_bytes", "name"),
    [
        ([], 20_000, "checkpoint.safetensors"),
        ([], 300_000, "resume.safetensors"),
        (["--restart"], 30, "log.jsonl"),
        (["--tensorboard"], 10, "tensorboard"),
    ],
)
def test_a_full_disk_is_one_line(
    more: list[str], n_bytes: int, name: str, shards_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    length = ["--workers", "0", "--cache-gb", "0", "--epochs", "1", "--epoch-size", "8"]
    with files_of_at_most(n_bytes):
        assert main(options(shards_dir, tmp_path / "run", *length, *more)) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("train: error: ")
    assert os.strerror(errno.EFBIG) in line
    assert name in line
    unfinished = [path for path in (tmp_path / "run").rglob("*") if path.suffix == ".part" or path.name == name]
    assert [path for path in unfinished if path.is_file() and path.suffix != ".jsonl"] == []
