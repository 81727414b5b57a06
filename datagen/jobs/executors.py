"""Where units of work run: processes of this machine, or a Dask cluster.

Both end with the job, however it ends. Processes hold one end of a pipe, their lifeline, whose other end only the job
has: when the job stops, or is killed, the pipe closes and each of them exits at once.
"""

import multiprocessing
import os
import signal
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from importlib import import_module
from multiprocessing.connection import Connection
from typing import Any, final

from pix2face.errors import UsageError

# Software OpenGL and linear algebra: work is spread over processes, where threads would only fight for cores. With no
# thread of its own llvmpipe draws in the caller's.
ONE_THREAD = {"LP_NUM_THREADS": "0", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
CONNECT_S = 10.0
WORKERS_COME_S = 60.0


class WorkPlace(ABC):
    """Where units run.

    Attributes:
        at_once: How many units to hand over at a time: enough that nobody waits, few enough that it is known which
            units a dying worker may have had.
    """

    at_once: int

    @abstractmethod
    @contextmanager
    def open(self) -> Iterator[Executor]:
        """Gives an executor. When the block raises, units that have not begun are dropped and its processes end."""
        yield from ()

    def check(self) -> None:
        """Called now and then while units run; a process pool notices by itself.

        Raises:
            UsageError: There is nobody left to finish them.
        """
        return

    def explain(self, error: BaseException) -> str | None:
        """What has happened, where an error of a unit means that its place of work is gone; else None."""
        return None


@final
class ProcessPool(WorkPlace):
    """Processes of this machine.

    Args:
        workers: How many.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self.at_once = 2 * workers

    @contextmanager
    def open(self) -> Iterator[Executor]:
        """A pool of new processes; broken ones are not repaired, but opened anew."""
        limit_threads()  # inherited by the processes, before they load anything
        context = multiprocessing.get_context("spawn")
        worker_end, own_end = context.Pipe(duplex=False)
        pool = ProcessPoolExecutor(
            self._workers, mp_context=context, initializer=_hang_on_lifeline, initargs=(worker_end,)
        )
        try:
            yield _Uninterrupted(pool)
        except BaseException:
            own_end.close()  # ends all workers, whatever they are doing
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
            own_end.close()
            worker_end.close()


@final
class DaskCluster(WorkPlace):
    """The workers of a running ``dask.distributed`` scheduler.

    Args:
        address: Such as ``tcp://host:8786``.

    Raises:
        UsageError: The package is not installed.
    """

    def __init__(self, address: str) -> None:
        try:
            self._distributed = import_module("distributed")
        except ImportError as error:
            raise UsageError(
                "--scheduler: expected the package distributed, found that it is not installed: "
                "pip install 'pix2face[distributed]'"
            ) from error
        self._address = address
        self._client: Any = None
        self.at_once = sys.maxsize  # the scheduler itself knows who has what, and workers may come and go

    @contextmanager
    def open(self) -> Iterator[Executor]:
        """An executor of the cluster; what has not begun is dropped when the block raises."""
        # Without a port the client fails half made, and what is left of it complains when it is deleted.
        if not self._address.rpartition(":")[2].isdigit():
            raise UsageError(
                f"--scheduler {self._address}: expected an address with a port, such as tcp://host:8786, found no port"
            )
        try:
            self._client = self._distributed.Client(self._address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise UsageError(
                f"--scheduler {self._address}: expected a dask scheduler such as tcp://host:8786, found none that "
                f"answers ({error}); start one with `dask scheduler`"
            ) from error
        try:
            self._wait_for_workers()
            yield _DaskExecutor(self._client)
        finally:
            self._client.close()

    def check(self) -> None:
        """Waits some time for workers to come back.

        Raises:
            UsageError: None came, or the scheduler is gone.
        """
        if self._client.status != "running":
            raise UsageError(f"--scheduler {self._address}: lost; start it and run the same command again")
        if not self._client.nthreads():
            self._wait_for_workers()

    def explain(self, error: BaseException) -> str | None:
        """The cluster itself tries a unit anew when its worker dies, and gives up after some."""
        if isinstance(error, self._distributed.KilledWorker):
            return "its worker died each time that it was tried (out of memory?)"
        if isinstance(error, CancelledError | self._distributed.CancelledError):
            return f"the scheduler {self._address} dropped it; is it still running?"
        return None

    def _wait_for_workers(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=WORKERS_COME_S)
        except TimeoutError as error:
            raise UsageError(
                f"--scheduler {self._address}: expected at least one worker, found none in {WORKERS_COME_S:.0f} s; "
                f"start some with `dask worker {self._address} --nthreads 1`"
            ) from error


def limit_threads() -> None:
    """Gives software OpenGL and linear algebra of this process and its children one thread, unless told otherwise."""
    for variable, n_threads in ONE_THREAD.items():
        os.environ.setdefault(variable, n_threads)


@final
class _Uninterrupted(Executor):
    """A process pool whose processes are started with SIGINT blocked.

    Ctrl-C reaches every process of a terminal's foreground. The job decides what becomes of its workers; without this
    each of them would print a traceback of its own.
    """

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Hands over a call; new processes inherit the mask of signals of this moment."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return self._pool.submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@final
class _DaskExecutor(Executor):
    """Hands calls to a client; calls with equal arguments are not one call to it."""

    def __init__(self, client: Any) -> None:
        self._executor = client.get_executor(pure=False)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Hands over a call."""
        return self._executor.submit(fn, *args, **kwargs)


def _hang_on_lifeline(lifeline: Connection) -> None:
    """Ends this process as soon as the other end of the pipe is closed: what a worker does first."""

    def watch() -> None:
        try:
            lifeline.poll(None)
        finally:
            os._exit(1)

    threading.Thread(target=watch, name="lifeline", daemon=True).start()
