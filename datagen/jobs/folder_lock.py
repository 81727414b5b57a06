"""Locks a folder of shards: one job at a time writes to it, and its workers for as long as they live.

A lock is ``flock`` on a file beside the shards. The kernel releases it when its holder ends, however that ends, so
``kill -9`` leaves no lock. The files are removed with the last lock.

- ``.render.lock`` is held by the job alone.
- ``.render.workers.lock`` is shared by all workers while they make a shard. A process that holds it alone knows that no
  worker of an earlier, killed job still writes, and may remove unfinished files.
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
# Errors of file systems without locks (some network and FUSE mounts).
_NO_LOCKS = {errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.ENOLCK, errno.EINVAL}
UNFINISHED_SHARDS = ".shard-*.part"


class LocksUnsupportedError(Exception):
    """The file system has no locks."""


@final
class FolderLock:
    """A lock that is held until ``release``. The file of a lock that is held alone is then removed."""

    def __init__(self, path: Path, descriptor: int, alone: bool) -> None:
        self._path, self._descriptor, self._alone = path, descriptor, alone

    def release(self) -> None:
        """Releases the lock. A process that waited for a removed file notices, and opens the new one."""
        if self._alone:
            self._path.unlink(missing_ok=True)
        os.close(self._descriptor)


def take_lock(path: Path, *, alone: bool, wait_s: float = 0.0) -> FolderLock | None:
    """Locks a file, which is made if it does not exist, ``alone`` or shared with others.

    Returns:
        The lock, or None if another process still holds it after the wait.

    Raises:
        LocksUnsupportedError: The file system has no locks.
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
    """Locks the folder of a job.

    Yields:
        None, or a warning if the file system has no locks.

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
    with suppress(OSError):  # on a full disk: the holder's name is not needed
        path.write_text(f"process {os.getpid()} on {socket.gethostname()}", encoding="utf-8")
    try:
        yield None
    finally:
        lock.release()


@contextmanager
def worker_lock(folder: Path) -> Iterator[None]:
    """Shares the workers' lock of a folder while a worker writes to it."""
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
    """Removes the unfinished files of killed workers, once no worker writes any more. The caller holds the job's lock.

    Returns:
        Whether nothing unfinished is left. Otherwise a worker still writes, or the file system has no locks.
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
    """Whether a path still names the file that was opened. Its holder may have removed it meanwhile."""
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
