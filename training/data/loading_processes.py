"""Processes that load batches ahead, each at the other end of a pipe.

Nothing lies in ``/dev/shm``, which containers limit and some machines lack: requests go through the pipes, and batches
lie in anonymous memory whose descriptors do. So a process that dies is noticed at once (its pipe closes), and the
processes end when the trainer does, however it ends.
"""

import mmap
import os
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import cycle
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import recv_handle, send_handle
from multiprocessing.util import Finalize
from typing import Generic, final

import cv2

from pix2face.errors import Pix2FaceError
from pix2face.stop_signals import signals_blocked
from training.data.batches import B, Draws, layout_bytes, tensors_in
from training.data.shared_cache import anonymous_file

# Batches that each process has ready or in work: enough to bridge the writing of a checkpoint.
PREFETCHED = 4


@final
class LoadingProcesses(Generic[B]):
    """Processes that make batches of a data set.

    Args:
        dataset: What they load from.
        count: How many there are.

    Raises:
        OSError: A process cannot be started.
    """

    def __init__(self, dataset: Draws[B], count: int) -> None:
        self._dataset = dataset
        self._processes: list[BaseProcess] = []
        self._pipes: list[Connection] = []
        # Runs in ``end`` or when the interpreter ends, before multiprocessing waits for its processes.
        self._end = Finalize(self, _kill, (self._processes, self._pipes), exitpriority=0)
        context = get_context("spawn")
        resource_tracker.ensure_running()  # else it starts with the first process, and unblocks the signals
        # Signals to the whole group of processes are the trainer's to obey: it still wants a batch for the step under
        # way, and ends the processes. They inherit what is blocked.
        with signals_blocked():
            for _ in range(count):
                own_end, other_end = context.Pipe()
                process = context.Process(target=_serve, args=(other_end, dataset), name="loader", daemon=True)
                process.start()
                other_end.close()  # else it would not be noticed when the process closes its copy
                self._processes.append(process)
                self._pipes.append(own_end)

    def batches(self, draws_of_batches: Iterable[Sequence[int]]) -> Iterator[B]:
        """The batches of these draws, in order.

        Raises:
            InputFileError: A sample is damaged.
            Pix2FaceError: A process died.
        """
        asked = deque[tuple[Connection, int]]()
        for pipe, draws in zip(cycle(self._pipes), draws_of_batches, strict=False):
            with suppress(BrokenPipeError, ConnectionResetError):  # waiting for the answer says why
                pipe.send(draws)
            asked.append((pipe, len(draws)))
            if len(asked) == PREFETCHED * len(self._pipes):
                yield self._answer(*asked.popleft())
        while asked:
            yield self._answer(*asked.popleft())

    def end(self) -> None:
        """Ends the processes, whatever they are doing: they only read files."""
        self._end()

    def _answer(self, pipe: Connection, n_samples: int) -> B:
        ready = wait([pipe, *(process.sentinel for process in self._processes)])
        try:
            if pipe in ready:
                error = pipe.recv()
                if error is not None:
                    raise error
                memory = _mapped(recv_handle(pipe))
                return self._dataset.of_tensors(tensors_in(self._dataset.layout(n_samples), memory))
        except (EOFError, ConnectionResetError):
            pass
        raise Pix2FaceError(_reason(self._processes))


def _serve(pipe: Connection, dataset: Draws[B]) -> None:
    """Answers requests until the trainer closes its end, or is gone."""
    cv2.setNumThreads(1)  # processes run side by side, where threads of each would be in the way of the others
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            draws = pipe.recv()
            try:
                memory = anonymous_file(layout_bytes(dataset.layout(len(draws))))
                dataset.batch(draws, _mapped(os.dup(memory)))
            except Exception as error:  # noqa: BLE001 (whatever it is, the trainer is to say it)
                pipe.send(error)
                continue
            pipe.send(None)
            send_handle(pipe, memory, None)
            os.close(memory)


def _mapped(descriptor: int) -> mmap.mmap:
    """Maps a file, of which only the map is kept open."""
    try:
        return mmap.mmap(descriptor, 0)
    finally:
        os.close(descriptor)


def _kill(processes: Sequence[BaseProcess], pipes: Sequence[Connection]) -> None:
    for process in processes:
        process.kill()
    for process in processes:
        process.join()
    for pipe in pipes:
        pipe.close()


def _reason(processes: Sequence[BaseProcess]) -> str:
    for process in processes:
        process.join(0.1)
    status = next((process.exitcode for process in processes if process.exitcode is not None), None)
    by = f"signal {-status}" if status is not None and status < 0 else f"exit status {status}"
    return (
        f"a process that loads samples ended unexpectedly ({by}). Was it killed for lack of memory? Give fewer "
        "--workers or a smaller --cache-gb; the same command goes on from the last state"
    )
