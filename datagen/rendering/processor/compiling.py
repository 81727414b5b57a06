"""Compiles functions for this processor, once: later processes load what the first has compiled.

Numba keeps it beside the source or in the user's cache folder. Where neither can be written to, a private temporary
folder serves. Several processes may start at once: each file is written under another name and renamed.
"""

import inspect
import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numba
from numba.core import config

F = TypeVar("F", bound=Callable[..., object])
CACHE_VARIABLE = "NUMBA_CACHE_DIR"


def compiled(function: F) -> F:
    """Compiles a function when it is first called. Floats follow IEEE 754, so that results are the same everywhere."""
    # Under pytest, signatures are checked by a wrapper, which Numba cannot compile.
    plain = inspect.unwrap(function)
    compile_later: Callable[[F], F] = numba.njit(cache=True, error_model="numpy")
    try:
        return compile_later(plain)
    except RuntimeError:  # no folder of Numba's own choice can be written to
        folder = os.fspath(private_folder(Path(tempfile.gettempdir())))
        os.environ[CACHE_VARIABLE] = folder  # also for the processes that this one starts
        config.reload_config()  # type: ignore[no-untyped-call]
        return compile_later(plain)


def private_folder(parent: Path) -> Path:
    """A folder that only this user can write to: what lies in it is run.

    The same one for all processes of the user, unless somebody else has taken its name.
    """
    folder = parent / f"pix2face-compiled-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return Path(tempfile.mkdtemp(dir=parent))
    is_own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return folder if is_own else Path(tempfile.mkdtemp(dir=parent))
