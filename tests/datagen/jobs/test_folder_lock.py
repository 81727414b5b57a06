"""Locks that outlive nobody: held by processes, given back however these end."""

import errno
import fcntl
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from datagen.jobs.folder_lock import (
    JOB_LOCK,
    WORKERS_LOCK,
    LocksUnsupportedError,
    job_lock,
    remove_unfinished,
    take_lock,
    worker_lock,
)
from pix2face.errors import UsageError

ROOT = Path(__file__).parents[3]
HOLD = """
import sys, time
from pathlib import Path
from datagen.jobs.folder_lock import job_lock, worker_lock
with {lock}(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def holder(folder: Path, lock: str) -> "subprocess.Popen[str]":
    """Another process that holds a lock."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD.format(lock=lock), str(folder)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def n_open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def kill(process: "subprocess.Popen[str]") -> None:
    process.send_signal(signal.SIGKILL)
    process.communicate()


def test_two_jobs_are_one_too_many(tmp_path: Path) -> None:
    with (
        job_lock(tmp_path) as warning,
        pytest.raises(UsageError, match=rf"found another `datagen render` \(process {os.getpid()} on .*\); wait"),
        job_lock(tmp_path),
    ):
        pass
    assert warning is None
    assert list(tmp_path.iterdir()) == []  # the files go with the locks
    with job_lock(tmp_path):
        pass


def test_a_killed_job_holds_nothing(tmp_path: Path) -> None:
    process = holder(tmp_path, "job_lock")
    with pytest.raises(UsageError, match=f"process {process.pid} on"), job_lock(tmp_path):
        pass
    kill(process)
    assert (tmp_path / JOB_LOCK).exists()
    with job_lock(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_unfinished_shards_stay_while_a_worker_lives(tmp_path: Path) -> None:
    unfinished, other = tmp_path / ".shard-00003.h5.abc.part", tmp_path / ".mine.part"
    unfinished.touch()
    other.touch()
    process = holder(tmp_path, "worker_lock")
    with worker_lock(tmp_path):  # two workers do not exclude each other
        assert not remove_unfinished(tmp_path, wait_s=0.2)
    assert not remove_unfinished(tmp_path, wait_s=0.2)
    assert unfinished.exists()
    kill(process)
    assert remove_unfinished(tmp_path)
    assert list(tmp_path.iterdir()) == [other]


def test_a_lock_whose_file_is_gone_locks_nothing(tmp_path: Path) -> None:
    """Between opening and locking, the holder may have removed the file: then the next one must make it anew."""
    path = tmp_path / "lock"
    first = take_lock(path, alone=True)
    assert first is not None
    waiting = os.open(path, os.O_RDWR)
    first.release()
    fcntl.flock(waiting, fcntl.LOCK_EX)  # of a file that nobody finds any more
    second = take_lock(path, alone=True)
    assert second is not None
    assert take_lock(path, alone=True) is None
    assert take_lock(path, alone=False) is None
    second.release()
    os.close(waiting)


@pytest.mark.parametrize("code", [errno.ENOTSUP, errno.ENOSYS, errno.ENOLCK])
def test_a_file_system_without_locks_is_said_to_be_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    def refuse(descriptor: int, operation: int) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(LocksUnsupportedError):
        take_lock(tmp_path / "lock", alone=True)
    with job_lock(tmp_path) as warning:
        assert warning is not None
        assert "has no locks (flock): make sure that no other job writes" in warning
        with worker_lock(tmp_path):
            pass
        (tmp_path / ".shard-00000.h5.x.part").touch()
        assert not remove_unfinished(tmp_path)  # nobody can say that no worker uses it
    assert (tmp_path / ".shard-00000.h5.x.part").exists()


def test_other_errors_of_the_system_are_not_taken_for_a_held_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(descriptor: int, operation: int) -> None:
        raise OSError(errno.EIO, "broken")

    before = n_open_files()
    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(OSError, match="broken"):
        take_lock(tmp_path / "lock", alone=True)
    assert n_open_files() == before


def test_locks_leave_no_file_of_workers(tmp_path: Path) -> None:
    with job_lock(tmp_path):
        assert remove_unfinished(tmp_path)
        with worker_lock(tmp_path):
            assert (tmp_path / WORKERS_LOCK).exists()
        assert remove_unfinished(tmp_path)
        assert not (tmp_path / WORKERS_LOCK).exists()
