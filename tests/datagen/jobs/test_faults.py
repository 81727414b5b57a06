"""Whatever happens to a job, what it finished stays, and in the end its folder is that of an undisturbed run."""

import os
import resource
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from datagen.cli import main
from tests.datagen.job_runs import (
    N_SHARDS,
    Inputs,
    changed,
    content,
    differing,
    finished_shards,
    kill,
    wait_for_shards,
    wait_until_dead,
    workers_of,
)

pytestmark = [
    pytest.mark.gl,
    pytest.mark.xdist_group("disturbed jobs"),  # the undisturbed one is run once
]


@pytest.mark.usefixtures("measured_processes")
def test_any_number_of_workers_gives_the_same_bytes(
    inputs: Inputs, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    """Three; the tests below have two."""
    inputs.run(tmp_path, workers=3)
    assert differing(tmp_path, undisturbed) == []


def test_inputs_that_lie_elsewhere_give_the_same_bytes(
    inputs: Inputs, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    """Also what is said of the photograph that is missing."""
    shutil.copytree(inputs.folder, tmp_path / "copy")
    Inputs(tmp_path / "copy").run(tmp_path / "out")
    assert differing(tmp_path / "out", undisturbed) == []
    assert b'"reason": "missing.jpg: ' in undisturbed["rejected.jsonl"]


def test_kill_9_of_the_job_at_any_moment(inputs: Inputs, undisturbed: dict[str, bytes], tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    kept: dict[str, bytes] = {}
    for n in sorted(rng.choice(np.arange(N_SHARDS), size=2, replace=False)):
        process = inputs.start(tmp_path)
        wait_for_shards(tmp_path, int(n), process)
        time.sleep(rng.uniform(0, 0.1))
        workers = workers_of(process)
        kill(process)
        wait_until_dead(workers)  # they end with their job
        now = {path.name: path.read_bytes() for path in finished_shards(tmp_path)}
        assert changed(kept, now) == []
        assert changed(now, undisturbed) == []  # what has its name is finished
        kept = now
    inputs.run(tmp_path)
    assert differing(tmp_path, undisturbed) == []


def test_workers_that_are_killed_are_replaced(inputs: Inputs, undisturbed: dict[str, bytes], tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    process = inputs.start(tmp_path, workers=2)
    for n in (1, 5):
        wait_for_shards(tmp_path, n, process)
        workers = workers_of(process)
        if workers:
            os.kill(workers[rng.integers(len(workers))], signal.SIGKILL)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    assert differing(tmp_path, undisturbed) == []


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signals_stop_cleanly(
    inputs: Inputs, undisturbed: dict[str, bytes], tmp_path: Path, number: int, status: int
) -> None:
    process = inputs.start(tmp_path)
    wait_for_shards(tmp_path, 2, process)
    workers = workers_of(process)
    os.killpg(process.pid, number)  # as a terminal does with Ctrl-C, and a batch system at the end of the time
    _, errors = process.communicate(timeout=30)
    assert process.returncode == status, errors
    assert "Traceback" not in errors
    wait_until_dead(workers, timeout_s=2)
    kept = content(tmp_path)
    assert set(kept) == {path.name for path in finished_shards(tmp_path)}  # nothing unfinished, no lock
    assert changed(kept, undisturbed) == []
    assert f"{len(kept)} finished shards kept in {tmp_path}, left behind: nothing unfinished; run" in errors
    assert "run the same command again to go on" in errors
    said = inputs.run(tmp_path)
    assert f"({len(kept)} there already)" in said
    assert differing(tmp_path, undisturbed) == []


def test_a_second_job_in_the_same_folder_is_refused(
    inputs: Inputs, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    process = inputs.start(tmp_path)
    wait_for_shards(tmp_path, 1, process)
    process.send_signal(signal.SIGSTOP)  # it holds the folder, and does not end meanwhile
    second = inputs.start(tmp_path)
    _, errors = second.communicate(timeout=60)
    process.send_signal(signal.SIGCONT)
    assert second.returncode == 2
    assert f"found another `datagen render` (process {process.pid} on " in errors
    assert process.wait(timeout=120) == 0
    process.communicate()
    assert differing(tmp_path, undisturbed) == []


def test_a_full_disk_costs_the_unfinished_shard(inputs: Inputs, undisturbed: dict[str, bytes], tmp_path: Path) -> None:
    """No file may grow beyond a limit: writing fails as it does when the disk is full, but for the word."""
    sizes = sorted(len(file) for name, file in undisturbed.items() if name.startswith("shard-"))
    limit = sizes[len(sizes) // 2]
    command = inputs.command(tmp_path, "--workers", 1)

    def bounded() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # an error of the write then, as ENOSPC is
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    # Coverage could not write its own file either.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("COVERAGE")}
    process = subprocess.run(
        command,
        cwd=Path(__file__).parents[3],
        env=environment,
        preexec_fn=bounded,
        capture_output=True,
        text=True,
    )
    assert process.returncode == 2
    assert process.stderr.splitlines()[-1].startswith("datagen: error: ")
    assert "make room or choose another folder" in process.stderr.splitlines()[-1]
    kept = content(tmp_path)
    assert changed(kept, undisturbed) == []
    assert all(name.startswith("shard-") for name in kept)
    inputs.run(tmp_path)
    assert differing(tmp_path, undisturbed) == []


def test_stale_files_and_damaged_shards_are_replaced(
    inputs: Inputs, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    for name, file in undisturbed.items():
        (tmp_path / name).write_bytes(file)
    names = [name for name in undisturbed if name.startswith("shard-")]
    (tmp_path / names[0]).write_bytes(undisturbed[names[0]][: len(undisturbed[names[0]]) // 2])
    (tmp_path / names[1]).write_bytes(b"")
    (tmp_path / names[2]).write_bytes(bytes(5000))
    (tmp_path / names[3]).unlink()  # found by verify, deleted by the user
    (tmp_path / ".shard-00004.h5.1234.part").write_bytes(b"half a shard")
    (tmp_path / ".render.lock").write_text("process 1 on a machine that is no more")
    (tmp_path / ".render.workers.lock").touch()
    said = inputs.run(tmp_path)
    assert all(f"{tmp_path / name} is cut short or damaged: it is made anew" in said for name in names[:3])
    assert f"({N_SHARDS - 4} there already)" in said
    assert differing(tmp_path, undisturbed) == []


def test_a_shard_in_the_place_of_another_is_refused(
    inputs: Inputs, undisturbed: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, file in undisturbed.items():
        (tmp_path / name).write_bytes(file)
    (tmp_path / "shard-00001.h5").write_bytes(undisturbed["shard-00000.h5"])
    assert main(inputs.command(tmp_path, "--workers", 1)[3:]) == 2
    assert f"{tmp_path / 'shard-00001.h5'}: expected the 4 samples from" in capsys.readouterr().err
