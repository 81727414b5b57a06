"""Memory for decoded samples that all worker processes share, so that a sample is decoded only once.

Nothing is ever evicted: training passes over all samples ask for each equally often, so replacing one gains nothing.
"""

import fcntl
import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import assert_spawning
from multiprocessing.reduction import DupFd
from typing import Any, final

import numpy as np

_ABSENT, _PROMISED = 0, -1
_WORD = 8
_ALIGNMENT = 64


@final
class SharedCache:
    """Numbered pieces of bytes, from 0 to ``n_places``, which are written once and never changed.

    Together they take at most ``budget_bytes``; memory is taken as they come. A cache can be given to another process
    only as an argument when that process is started. One thread of each process may write: the lock keeps out other
    processes only.
    """

    def __init__(self, n_places: int, budget_bytes: int) -> None:
        table_bytes = _WORD * (2 * n_places + 1)
        self._open(anonymous_file(table_bytes + budget_bytes), n_places, budget_bytes)

    def __getstate__(self) -> dict[str, Any]:
        assert_spawning(self)
        return {"descriptor": DupFd(self._descriptor), "sizes": (self._n_places, self._budget_bytes)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._open(state["descriptor"].detach(), *state["sizes"])

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
        with self._locked():
            start = int(self._used[0])
            if self._table[place, 0] != _ABSENT or start + len(piece) > self._budget_bytes:
                return
            self._table[place] = _PROMISED, len(piece)
            self._used[0] = start + -(-len(piece) // _ALIGNMENT) * _ALIGNMENT
        self._pieces[start : start + len(piece)] = piece
        with self._locked():
            self._table[place, 0] = start + 1

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Keeps other processes out. A process that dies lets them in."""
        fcntl.lockf(self._descriptor, fcntl.LOCK_EX)
        try:
            yield
        finally:
            fcntl.lockf(self._descriptor, fcntl.LOCK_UN)

    def _open(self, descriptor: int, n_places: int, budget_bytes: int) -> None:
        self._descriptor, self._n_places, self._budget_bytes = descriptor, n_places, budget_bytes
        memory = memoryview(mmap.mmap(descriptor, 0))
        words = np.frombuffer(memory, np.int64, 2 * n_places + 1)
        self._used, self._table = words[:1], words[1:].reshape(n_places, 2)
        self._pieces = memory[words.nbytes :]


def anonymous_file(n_bytes: int) -> int:
    """The descriptor of a file without a name, full of 0, that takes no memory before it is written to.

    It is not in /dev/shm, whose size containers limit: writing beyond the limit ends a process without a message.
    """
    descriptor = os.memfd_create("pix2face-samples")
    os.ftruncate(descriptor, n_bytes)
    return descriptor
