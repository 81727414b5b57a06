"""The same shards from a Dask cluster, also when one of its workers is killed while it works."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from datagen.cli import main
from datagen.jobs import executors
from datagen.jobs.executors import DaskCluster
from pix2face.errors import UsageError
from tests.datagen.job_runs import ROOT, Inputs, differing, kill, wait_for_shards

pytest.importorskip("distributed", reason="needs pip install 'pix2face[distributed]'")
pytestmark = [pytest.mark.gl, pytest.mark.xdist_group("disturbed jobs")]


def start(program: str, *arguments: object) -> "subprocess.Popen[str]":
    """A scheduler or a worker on loopback, with nothing to look at."""
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{program}", *map(str, arguments), "--no-dashboard"],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__WORKER__DAEMON": "False"},
    )


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    file = tmp_path / "scheduler.json"
    process = start("scheduler", "--host", "127.0.0.1", "--port", 0, "--scheduler-file", file)
    try:
        yield address_in(file)
    finally:
        kill(process)


def address_in(file: Path) -> str:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        try:
            return str(json.loads(file.read_text())["address"])
        except (OSError, ValueError):
            time.sleep(0.05)
    raise AssertionError("no scheduler")


def worker(address: str, folder: Path, threads: int = 1) -> "subprocess.Popen[str]":
    return start(
        "worker", address, "--nthreads", threads, "--no-nanny", "--host", "127.0.0.1", "--local-directory", folder
    )


def test_a_cluster_whose_worker_is_killed_makes_the_same_shards(
    scheduler: str, inputs: Inputs, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    workers = [worker(scheduler, tmp_path / f"worker{threads}", threads) for threads in (1, 2)]
    try:
        job = inputs.start(tmp_path / "out", "--scheduler", scheduler)
        wait_for_shards(tmp_path / "out", 2, job)
        workers[1].send_signal(signal.SIGKILL)
        _, errors = job.communicate(timeout=200)
        assert job.returncode == 0, errors
        assert differing(tmp_path / "out", undisturbed) == []
        stopped = inputs.start(tmp_path / "stopped", "--scheduler", scheduler)
        wait_for_shards(tmp_path / "stopped", 1, stopped)
        stopped.send_signal(signal.SIGTERM)
        _, errors = stopped.communicate(timeout=60)
        assert stopped.returncode == 143, errors
        inputs.run(tmp_path / "stopped", "--scheduler", scheduler)
        assert differing(tmp_path / "stopped", undisturbed) == []
    finally:
        for process in workers:
            kill(process)


def test_a_scheduler_that_is_killed_ends_the_job_in_one_line(inputs: Inputs, tmp_path: Path) -> None:
    file = tmp_path / "scheduler.json"
    process = start("scheduler", "--host", "127.0.0.1", "--port", 0, "--scheduler-file", file)
    only_worker = worker(address_in(file), tmp_path / "worker")
    try:
        job = inputs.start(tmp_path / "out", "--scheduler", address_in(file))
        wait_for_shards(tmp_path / "out", 1, job)
        kill(process)
        _, errors = job.communicate(timeout=120)
    finally:
        kill(only_worker)
        process.kill()
    assert job.returncode == 2, errors
    line = next(line for line in errors.splitlines() if line.startswith("datagen: error: "))
    assert "scheduler" in line


def test_a_scheduler_without_workers_is_one_line(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "WORKERS_COME_S", 0.5)
    with (
        pytest.raises(UsageError, match=r"expected at least one worker, found none in .* `dask worker tcp://"),
        DaskCluster(scheduler).open(lambda unit, n_done: None),
    ):
        pass


def test_no_scheduler_is_one_line(
    inputs: Inputs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(executors, "CONNECT_S", 1)
    arguments = inputs.command(tmp_path / "out", "--scheduler", "tcp://127.0.0.1:1")[3:]
    assert main(arguments) == 2
    error = capfd.readouterr().err.splitlines()[-1]
    assert error.startswith("datagen: error: --scheduler tcp://127.0.0.1:1: expected a dask scheduler")
    assert "`dask scheduler`" in error


def test_an_address_without_a_port_is_one_line(
    inputs: Inputs, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    arguments = inputs.command(tmp_path / "out", "--scheduler", "localhost")[3:]
    assert main(arguments) == 2
    error = capfd.readouterr().err
    assert "Traceback" not in error
    assert error.splitlines()[-1].endswith("expected an address with a port, such as tcp://host:8786, found no port")


def test_without_the_package_its_name_is_said(
    inputs: Inputs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(inputs.command(tmp_path / "out", "--scheduler", "tcp://127.0.0.1:8786")[3:]) == 2
    assert "pip install 'pix2face[distributed]'" in capfd.readouterr().err.splitlines()[-1]
