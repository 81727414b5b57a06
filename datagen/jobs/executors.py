"""Where units of work run: processes of this machine, or a Dask cluster. Both end with the job, however it ends."""

import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import AbstractContextManager, contextmanager
from importlib import import_module
from typing import Any, final

from datagen.process_pool import OnReport, process_pool
from pix2face.errors import UsageError

CONNECT_S = 10.0
WORKERS_COME_S = 60.0


class WorkPlace(ABC):
    """Where units run."""

    # How many units to hand over at a time: enough that no worker waits, and few enough that it is known which units a
    # dying worker may have had.
    at_once: int

    @abstractmethod
    def open(self, on_report: OnReport) -> AbstractContextManager[Executor]:
        """Gives an executor. When the block raises, units that have not begun are dropped and its processes end.

        Processes of this machine say how many faces of a unit are done: ``on_report`` receives unit and number.
        """

    def check(self) -> None:
        """Called now and then while units run; a process pool notices by itself.

        Raises:
            UsageError: No worker is left.
        """
        return

    def explain(self, error: BaseException) -> str | None:
        """What has happened, if an error of a unit means that its place of work is gone; otherwise None."""
        return None


@final
class ProcessPool(WorkPlace):
    """Processes of this machine."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self.at_once = 2 * workers

    def open(self, on_report: OnReport) -> AbstractContextManager[Executor]:
        """A pool of new processes. A broken pool is not repaired; another one is opened."""
        return process_pool(self._workers, on_report)


@final
class DaskCluster(WorkPlace):
    """The workers of a running ``dask.distributed`` scheduler, at an address such as ``tcp://host:8786``.

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
    def open(self, on_report: OnReport) -> Iterator[Executor]:
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
            yield self._client.get_executor(pure=False)  # calls with equal arguments are not one call
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
