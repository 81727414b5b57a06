"""Programs as a shell or torchrun starts them: several at once, stopped, killed."""

import json
import os
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from pix2face.inference.weight_files import read_header
from training import train_cli
from training.cli import main
from training.loop.resume import METADATA_KEY, SCHEMA_VERSION
from training.loop.trainer import LOG_NAME, RESUME_NAME, train

PATIENCE_SECONDS = 60
SMALL = ["--preset", "tiny", "--size-px", "32", "--filters", "4", "--batch-size", "4", "--precision", "float32"]


def options(shards: Path, out: Path, *more: str) -> list[str]:
    return ["--shards", str(shards), "--out", str(out), "--workers", "0", "--device", "cpu", *SMALL, *more]


def start(arguments: list[str], **environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "training.cli", *arguments],
        env={**os.environ, "OMP_NUM_THREADS": "1", **environment},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def start_two(arguments: list[str]) -> list[subprocess.Popen[str]]:
    """As ``torchrun --nproc-per-node 2`` does."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    shared = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "GLOO_SOCKET_IFNAME": "lo"}
    return [start(arguments, RANK=str(rank), LOCAL_RANK=str(rank), **shared) for rank in range(2)]


def losses(out: Path) -> list[float]:
    return [json.loads(line)["loss"] for line in (out / LOG_NAME).read_text().splitlines()]


def steps_in(out: Path) -> int:
    if not (out / RESUME_NAME).exists():
        return 0
    return int(read_header(out / RESUME_NAME, METADATA_KEY, SCHEMA_VERSION)["step"])


def wait_for_steps(out: Path, steps: int, process: subprocess.Popen[str]) -> None:
    until = time.monotonic() + PATIENCE_SECONDS
    while steps_in(out) < steps:
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < until, "no state was written"
        time.sleep(0.05)


@pytest.mark.usefixtures("measured_processes")
def test_two_processes_have_the_losses_of_one(shards_dir, tmp_path):
    epochs = ["--epochs", "8", "--epoch-size", "4"]  # a step each, and so a line of the log
    pair = start_two(options(shards_dir, tmp_path / "two", *epochs))
    assert main(options(shards_dir, tmp_path / "one", *epochs)) == 0
    for process in pair:
        assert process.wait(PATIENCE_SECONDS) == 0, process.communicate()[1]
        process.communicate()
    assert len(losses(tmp_path / "one")) == 8
    assert losses(tmp_path / "two") == pytest.approx(losses(tmp_path / "one"), rel=1e-3)


def test_when_one_process_is_killed_the_state_goes_on(shards_dir, tmp_path, monkeypatch):
    out = tmp_path / "run"
    arguments = options(shards_dir, out, "--epochs", "1", "--state-minutes", "0")
    pair = start_two([*arguments, "--epoch-size", "4000"])
    wait_for_steps(out, 2, pair[0])
    pair[1].kill()
    _, said = pair[0].communicate(timeout=PATIENCE_SECONDS)
    pair[1].communicate()
    assert pair[0].returncode == 2
    assert "Did another process end? The same command goes on from the last state" in said
    done = steps_in(out)
    assert done >= 2

    def stopped(*given, **named):
        stop = replace(named.pop("observers"), should_stop=lambda: steps_in(out) >= done + 2)
        return train(*given, **named, observers=stop)

    monkeypatch.setattr(train_cli, "train", stopped)
    assert main([*arguments, "--epoch-size", "4000"]) == 143
    assert steps_in(out) >= done + 2


def test_a_signal_to_one_of_two_stops_both(shards_dir, tmp_path):
    out = tmp_path / "run"
    pair = start_two(options(shards_dir, out, "--epochs", "1000", "--epoch-size", "8"))
    wait_for_steps(out, 2, pair[0])
    pair[1].terminate()
    said = [process.communicate(timeout=PATIENCE_SECONDS)[1] for process in pair]
    assert [process.returncode for process in pair] == [143, 143], said
    assert f"stopped after {4 * steps_in(out)} samples; the same command goes on from there" in said[0]
