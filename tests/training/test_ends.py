"""``train`` ends by itself whatever fails, with one line and its exit status; and it works without ``/dev/shm``."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from safetensors import safe_open

from tests.full_disk import FULL, files_of_at_most
from tests.mounts import with_mount
from tests.training.conftest import copy_with_a_damaged_sample
from training.cli import main
from training.loop.resume import METADATA_KEY

PATIENCE_SECONDS = 60
ORPHANS_END_SECONDS = 5
BATCH_SIZE = 4
SMALL = ["--preset", "tiny", "--size-px", "32", "--filters", "4", "--batch-size", str(BATCH_SIZE), "--device", "cpu"]
# The first checkpoint is written after two steps, and nobody waits for the last.
LONG = ["--workers", "1", "--epochs", "1000", "--epoch-size", "8"]
NO_SHARED_MEMORY = "mount -t tmpfs -o ro none /dev/shm"
LITTLE_SHARED_MEMORY = "mount -t tmpfs -o size=64k none /dev/shm"


def options(shards: Path, out: Path, *more: str) -> list[str]:
    return ["--shards", str(shards), "--out", str(out), *SMALL, *more]


def start(arguments: list[str], mount: str = "") -> subprocess.Popen[str]:
    """Starts ``train``, where something is mounted for it alone."""
    command = [*(with_mount(mount) if mount else []), sys.executable, "-m", "training.cli", *arguments]
    return subprocess.Popen(
        command, env={**os.environ, "OMP_NUM_THREADS": "1"}, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def wait_for(is_there: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    began = time.monotonic()
    while not is_there():
        assert process.poll() is None
        assert time.monotonic() - began < PATIENCE_SECONDS
        time.sleep(0.05)


def end_of(process: subprocess.Popen[str]) -> tuple[int, list[str]]:
    """Exit status and lines said, of a process that ends by itself and leaves none behind."""
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
    return process.returncode, said.splitlines()


def children_of(process_id: int) -> list[int]:
    found = []
    for pid in Path(f"/proc/{process_id}/task/{process_id}/children").read_text().split():
        with suppress(OSError):  # it has ended meanwhile
            if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes():
                found.append(int(pid))
    return found


def test_a_damaged_sample_ends_it_with_its_workers(
    shards_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = children_of(os.getpid())
    path = copy_with_a_damaged_sample(shards_dir, tmp_path / "shards")
    assert main(options(tmp_path / "shards", tmp_path / "run", "--workers", "1")) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith(f"train: error: {path}: sample 'head-004' is damaged")
    until = time.monotonic() + ORPHANS_END_SECONDS
    while children_of(os.getpid()) != before:
        assert time.monotonic() < until, "processes are left behind"
        time.sleep(0.02)


def test_a_killed_worker_ends_it_and_it_needs_little_shared_memory(shards_dir: Path, tmp_path: Path) -> None:
    process = start(options(shards_dir, tmp_path / "run", *LONG), LITTLE_SHARED_MEMORY)
    wait_for((tmp_path / "run" / "checkpoint.safetensors").exists, process)
    (worker,) = children_of(process.pid)
    os.kill(worker, signal.SIGKILL)
    status, lines = end_of(process)
    assert status == 2
    assert "a process that loads samples ended unexpectedly (signal 9)" in lines[-1]


def test_a_signal_to_all_its_processes_saves_the_state_and_it_needs_no_shared_memory(
    shards_dir: Path, tmp_path: Path
) -> None:
    process = start(options(shards_dir, tmp_path / "run", *LONG), NO_SHARED_MEMORY)
    wait_for((tmp_path / "run" / "checkpoint.safetensors").exists, process)
    os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C does: to the workers, too
    status, lines = end_of(process)
    assert status == 128 + signal.SIGINT
    said = (re.fullmatch(r"stopped after (\d+) samples; the same command goes on from there", line) for line in lines)
    (n_samples,) = (int(found[1]) for found in said if found)
    with safe_open(tmp_path / "run" / "resume.safetensors", "pt") as state:
        assert BATCH_SIZE * json.loads(state.metadata()[METADATA_KEY])["step"] == n_samples


@pytest.mark.parametrize("folder", [Path("/sys"), Path("/dev/null")])
def test_a_folder_that_cannot_be_written_to_is_one_line(
    shards_dir: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In /sys not even the superuser can make one."""
    assert main(options(shards_dir, folder / "run")) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith(f"train: error: {folder / 'run'}: expected a folder that can be written to, found")


@pytest.mark.parametrize(
    ("more", "n_bytes", "name"),
    [
        ([], 20_000, "checkpoint.safetensors"),
        ([], 300_000, "resume.safetensors"),
        ([], 30, "configuration.json"),
        (["--restart"], 30, "log.jsonl"),
        (["--tensorboard"], 10, "tensorboard"),
    ],
)
def test_a_full_disk_is_one_line(
    more: list[str],
    n_bytes: int,
    name: str,
    shards_dir: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if name in ("log.jsonl", "tensorboard"):  # whose first lines are smaller than the configuration
        monkeypatch.setattr("training.train_cli.write_file", lambda path, content: None)
    length = ["--workers", "0", "--cache-gb", "0", "--epochs", "1", "--epoch-size", "8"]
    with files_of_at_most(n_bytes):
        assert main(options(shards_dir, tmp_path / "run", *length, *more)) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("train: error: ")
    assert FULL in line
    assert name in line
    unfinished = [path for path in (tmp_path / "run").rglob("*") if path.suffix == ".part" or path.name == name]
    assert [path for path in unfinished if path.is_file() and path.suffix != ".jsonl"] == []
