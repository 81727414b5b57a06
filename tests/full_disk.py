"""A disk that is full, as far as programs can tell."""

import errno
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager

# What the system then answers.
FULL = os.strerror(errno.EFBIG)


@contextmanager
def files_of_at_most(n_bytes: int) -> Iterator[None]:
    """While the block runs, each write beyond a file's first bytes fails."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
