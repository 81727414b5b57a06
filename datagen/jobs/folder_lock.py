"""Who may write to a folder of shards: one job at a time, and its workers for as long as they live.

Locks are ``flock`` on two files beside the shards. The kernel gives a lock back when its holder ends, however it ends,
so nothing is left to clean up after ``kill -9``; the files themselves go with the last lock.

- ``.render.lock`` is held alone by the job.
- ``.render.workers.lock`` is shared by all workers while they make a shard. Who holds it alone knows that no worker of
  an earlier, killed job is still writing: unfinished files may then be removed.
"""

import errno
import fcntl
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import final

from pix2face.errors import UsageError

JOB_LOCK = ".render.lock"
WORKERS_LOCK = ".render.workers.lock"
# Workers of a killed job notice its end within a moment; those of a cluster may finish their shard first.
WORKERS_END_S = 10.0
_RETRY_S = 0.05
# What file systems answer that have no locks (some network and FUSE mounts).
_NO_LOCKS = {errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.ENOLCK, errno.EINVAL}
UNFINISHED_SHARDS = ".shard-*.part"


class LocksUnsupportedError(Exception):
    """The file system has no locks."""


@final
class FolderLock:
    """A lock that is held; ``release`` gives it back.

    Args:
        path: The file that is locked.
        descriptor: Of the open file.
        alone: Whether nobody else can hold it; then the file goes with it.
    """

    def __init__(self, path: Path, descriptor: int, alone: bool) -> None:
        self._path, self._descriptor, self._alone = path, descriptor, alone

    def release(self) -> None:
        """Gives the lock back. Whoever waited for a file that is gone notices, and opens the new one."""
        if self._alone:
            self._path.unlink(missing_ok=True)
        os.close(self._descriptor)


def take_lock(path: Path, *, alone: bool, wait_s: float = 0.0) -> FolderLock | None:
    """Takes a lock.

    Args:
        path: The file to lock; made where it is not there.
        alone: Whether nobody else may hold it, or everybody who does not want it alone.
        wait_s: How long to try.

    Returns:
        The lock, or None where somebody else holds it.

    Raises:
        LocksUnsupportedError: The file system has none.
        OSError: The file cannot be made.
    """
    deadline = time.monotonic() + wait_s
    while True:
        lock = _try_lock(path, alone)
        if lock is not None or time.monotonic() >= deadline:
            return lock
        time.sleep(_RETRY_S)


@contextmanager
def job_lock(folder: Path) -> Iterator[str | None]:
    """Holds the folder of a job.

    Yields:
        None, or a warning where the file system has no locks.

    Raises:
        UsageError: Another job holds it.
    """
    path = folder / JOB_LOCK
    try:
        lock = take_lock(path, alone=True)
    except LocksUnsupportedError:
        yield f"{folder}: this file system has no locks (flock): make sure that no other job writes to the folder"
        return
    if lock is None:
        raise UsageError(
            f"{folder}: expected to be the only job that writes there, found another `datagen render`"
            f"{_holder(path)}; wait until it is done, or choose another --out"
        )
    with suppress(OSError):  # a full disk: the name of the holder is a courtesy
        path.write_text(f"process {os.getpid()} on {socket.gethostname()}", encoding="utf-8")
    try:
        yield None
    finally:
        lock.release()


@contextmanager
def worker_lock(folder: Path) -> Iterator[None]:
    """Says that a worker is writing to a folder."""
    try:
        lock = take_lock(folder / WORKERS_LOCK, alone=False, wait_s=WORKERS_END_S)
    except LocksUnsupportedError:
        lock = None
    try:
        yield
    finally:
        if lock is not None:
            lock.release()


def remove_unfinished(folder: Path, wait_s: float = WORKERS_END_S) -> bool:
    """Removes what killed workers left behind, once nobody uses it.

    Args:
        folder: Of a job whose lock the caller holds.
        wait_s: How long to wait for workers to end.

    Returns:
        Whether nothing unfinished is left; otherwise some worker still writes (or there are no locks to ask).
    """
    if not any(folder.glob(UNFINISHED_SHARDS)) and not (folder / WORKERS_LOCK).exists():
        return True
    try:
        lock = take_lock(folder / WORKERS_LOCK, alone=True, wait_s=wait_s)
    except LocksUnsupportedError:
        lock = None
    if lock is None:
        return False
    try:
        for path in folder.glob(UNFINISHED_SHARDS):
            path.unlink(missing_ok=True)
    finally:
        lock.release()
    return True


def _try_lock(path: Path, alone: bool) -> FolderLock | None:
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        if _is_still(path, descriptor):
            return FolderLock(path, descriptor, alone)
    except BlockingIOError:
        pass
    except OSError as error:
        os.close(descriptor)
        if error.errno in _NO_LOCKS:
            raise LocksUnsupportedError(str(path)) from error
        raise
    os.close(descriptor)
    return None


def _is_still(path: Path, descriptor: int) -> bool:
    """Whether a path still names the file that was opened: its holder may have removed it meanwhile."""
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _holder(path: Path) -> str:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""
    return f" ({text})" if text else ""
