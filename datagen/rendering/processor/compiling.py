"""Compiles loops over triangles and pixels with Numba."""

import inspect
from collections.abc import Callable
from typing import TypeVar

import numba

_Function = TypeVar("_Function", bound=Callable[..., object])


def compiled(function: _Function) -> _Function:
    """Compiles a function when it is first called, and keeps what was compiled on the disk for the next process.

    Where neither the package's folder nor the user's folder of caches can be written to, each process compiles anew.
    """
    plain = inspect.unwrap(function)  # without the checks of types that tests add
    try:
        return numba.njit(cache=True, error_model="numpy")(plain)  # type: ignore[no-any-return]
    except RuntimeError:  # Numba finds no folder for its cache
        return numba.njit(error_model="numpy")(plain)  # type: ignore[no-any-return]
