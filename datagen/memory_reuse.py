"""Freed memory stays with the process: a worker draws pictures of the same sizes over and over."""

import ctypes
import sys

# From glibc's malloc.h.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
# The largest that glibc takes for the second: arrays above it (none of a picture's) still come from the system.
KEPT_BYTES, LARGEST_ARRAY_BYTES = 1 << 28, 1 << 25


def keep_freed_memory() -> bool:
    """Asks malloc to keep what is freed instead of giving it back to the system.

    Arrays of some megabytes are otherwise given back and asked for again with every picture, and the system hands out
    each page anew and cleared: a quarter to a third of the time of drawing 450 x 450 pixels (docs/rendering.md). Both
    numbers count: setting one of them alone stops glibc from adapting the other, and makes things worse.

    Returns:
        Whether that could be asked for: glibc alone has it.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    return bool(mallopt(_M_MMAP_THRESHOLD, LARGEST_ARRAY_BYTES)) and bool(mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES))
