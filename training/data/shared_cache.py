"""Memory for decoded samples that all worker processes share, so that a sample is decoded only once.

Nothing is ever evicted: training passes over all samples ask for each equally often, so replacing one gains nothing.
"""

import mmap
import os
from multiprocessing.context import assert_spawning
from multiprocessing.reduction import DupFd
from types import TracebackType
from typing import Any, final

import numpy as np

_ABSENT, _PROMISED = 0, -1
_WORD = 8
_ALIGNMENT = 64


@final
class SharedCache:
    """Numbered pieces of bytes, from 0 to ``n_places``, which are written once and never changed.

    Together they take at most ``budget_bytes``; memory is taken as they come. A cache can be given to another process
    only as an argument when that process is started.
    """

    def __init__(self, n_places: int, budget_bytes: int) -> None:
        table_bytes = _WORD * (2 * n_places + 1)
        self._open(anonymous_file(table_bytes + budget_bytes), n_places, budget_bytes, _PipeLock(*os.pipe()))

    def __getstate__(self) -> dict[str, Any]:
        assert_spawning(self)
        sizes = self._n_places, self._budget_bytes
        return {"descriptor": DupFd(self._descriptor), "sizes": sizes, "lock": self._lock}

    def __setstate__(self, state: dict[str, Any]) -> None:
        n_places, budget_bytes = state["sizes"]
        self._open(state["descriptor"].detach(), n_places, budget_bytes, state["lock"])

    def __del__(self) -> None:
        if hasattr(self, "_descriptor"):
            os.close(self._descriptor)

    def get(self, place: int) -> memoryview | None:
        """The piece of a number, to be read only; None where there is none yet."""
        # Needs no lock, for which processes would wait at each sample: the start is written last, long after the rest.
        start = int(self._table[place, 0])
        return self._pieces[start - 1 : start - 1 + int(self._table[place, 1])] if start > 0 else None

    def put(self, place: int, piece: bytes) -> None:
        """Keeps a piece, unless there is no room or another process was faster."""
        with self._lock:
            start = int(self._used[0])
            if self._table[place, 0] != _ABSENT or start + len(piece) > self._budget_bytes:
                return
            self._table[place] = _PROMISED, len(piece)
            self._used[0] = start + -(-len(piece) // _ALIGNMENT) * _ALIGNMENT
        self._pieces[start : start + len(piece)] = piece
        with self._lock:
            self._table[place, 0] = start + 1

    def _open(self, descriptor: int, n_places: int, budget_bytes: int, lock: "_PipeLock") -> None:
        self._descriptor, self._n_places, self._budget_bytes, self._lock = descriptor, n_places, budget_bytes, lock
        memory = memoryview(mmap.mmap(descriptor, 0))
        words = np.frombuffer(memory, np.int64, 2 * n_places + 1)
        self._used, self._table = words[:1], words[1:].reshape(n_places, 2)
        self._pieces = memory[words.nbytes :]


@final
class _PipeLock:
    """A lock between processes that needs neither ``/dev/shm`` nor locks of a file system: a byte in a pipe.

    Args:
        reading: The pipe's end to read from.
        writing: The other end.
    """

    def __init__(self, reading: int, writing: int) -> None:
        self._reading, self._writing = reading, writing
        self.__exit__()

    def __getstate__(self) -> tuple[Any, Any]:
        return DupFd(self._reading), DupFd(self._writing)

    def __setstate__(self, state: tuple[Any, Any]) -> None:
        self._reading, self._writing = (end.detach() for end in state)

    def __enter__(self) -> None:
        os.read(self._reading, 1)

    def __exit__(
        self,
        kind: type[BaseException] | None = None,
        error: BaseException | None = None,
        trace: TracebackType | None = None,
    ) -> None:
        os.write(self._writing, b".")

    def __del__(self) -> None:
        os.close(self._reading)
        os.close(self._writing)


def anonymous_file(n_bytes: int) -> int:
    """The descriptor of a file without a name, full of 0, that takes no memory before it is written to.

    It is not in /dev/shm, whose size containers limit: writing beyond the limit ends a process without a message.
    """
    descriptor = os.memfd_create("pix2face-samples")
    os.ftruncate(descriptor, n_bytes)
    return descriptor
