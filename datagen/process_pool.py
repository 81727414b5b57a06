"""Processes of this machine that end together with the program that started them, however that ends.

Each process holds one end of a pipe, its lifeline, whose other end only the program has. When the program stops or is
killed, the pipe closes, and each process exits at once.
"""

import multiprocessing
import os
import signal
import struct
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any, final

from pix2face.errors import UsageError

# Work is spread over processes: threads of software OpenGL and of linear algebra would only fight for the same cores.
# Without a thread of its own llvmpipe draws in the caller's.
ONE_THREAD = {"LP_NUM_THREADS": "0", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


# A task and how much of it is done.
OnReport = Callable[[int, int], None]
_REPORT = struct.Struct("=qq")
# Where this process sends reports; empty in the program itself.
_REPORTS: list[Connection] = []


@contextmanager
def process_pool(workers: int, on_report: OnReport = lambda task, n_done: None) -> Iterator[Executor]:
    """Starts processes of one thread each. When the block raises, work that has not begun is dropped.

    Args:
        workers: How many.
        on_report: Receives what the processes ``report``, in a thread of its own.
    """
    limit_threads()  # inherited by the processes, before they load anything
    context = multiprocessing.get_context("spawn")
    worker_end, own_end = context.Pipe(duplex=False)
    reports, report_end = context.Pipe(duplex=False)
    listener = threading.Thread(target=_listen, args=(reports, on_report), name="reports", daemon=True)
    listener.start()
    try:
        pool = _UninterruptedPool(workers, context, initializer=_begin, initargs=(worker_end, report_end))
    except OSError as error:
        raise UsageError(
            "expected a /dev/shm that can be written to, where processes keep their semaphores, found: "
            f"{error.strerror}; mount one of some kilobytes"
        ) from error
    try:
        yield pool
    except BaseException:
        own_end.close()  # ends all processes, whatever they are doing
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        own_end.close()
        worker_end.close()
        report_end.close()  # the last end to write to, so the listener ends
        listener.join()
        reports.close()


def report(task: int, n_done: int) -> None:
    """Tells the program that started this process how much of a task is done.

    A report gets lost if the program does not keep up; the next one says all that it said.
    """
    for connection in _REPORTS:
        with suppress(OSError):
            connection.send_bytes(_REPORT.pack(task, n_done))


def limit_threads() -> None:
    """Gives software OpenGL and linear algebra of this process and its children one thread, unless told otherwise."""
    for variable, n_threads in ONE_THREAD.items():
        os.environ.setdefault(variable, n_threads)


@final
class _UninterruptedPool(ProcessPoolExecutor):
    """Starts its processes with SIGINT blocked.

    Ctrl-C reaches every process of a terminal's foreground. The program decides what becomes of its processes; without
    this each of them would print a traceback of its own.
    """

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Hands over a call. New processes inherit the mask of signals of this moment."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _listen(reports: Connection, on_report: OnReport) -> None:
    with suppress(EOFError, OSError):
        while True:
            on_report(*_REPORT.unpack(reports.recv_bytes()))


def _begin(lifeline: Connection, reports: Connection) -> None:
    """Prepares this process, which calls it first."""
    os.set_blocking(reports.fileno(), False)
    _REPORTS.append(reports)
    _hang_on_lifeline(lifeline)


def _hang_on_lifeline(lifeline: Connection) -> None:
    """Ends this process as soon as the other end of the pipe is closed."""

    def watch() -> None:
        try:
            lifeline.poll(None)
        finally:
            os._exit(1)

    threading.Thread(target=watch, name="lifeline", daemon=True).start()
