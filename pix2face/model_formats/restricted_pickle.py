"""Reads pickles of arrays without letting them run anything: no class and no function of a pickle is ever resolved.

A pickle is a program. This reader knows a small part of its language, and the few names that files of FLAME mention
(NumPy arrays, SciPy's sparse columns, chumpy's containers) become inert records of what they were given. Arrays are
made afterwards, from records whose sizes were checked. Any other name is refused, and the message tells which.
"""

import io
import math
import pickle  # noqa: TID251 (only the names of opcodes and a subclass that resolves nothing)
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, final

import numpy as np
from numpy import ndarray

from pix2face.errors import InputFileError

# What a name becomes. Both spellings of NumPy's and SciPy's modules are in circulation, and both of Python's builtins.
_ALLOWED: Final = {
    **{(f"numpy.{core}.multiarray", "_reconstruct"): "array" for core in ("core", "_core")},
    **{(f"numpy.{core}.multiarray", "scalar"): "scalar" for core in ("core", "_core")},
    **{(f"numpy.{core}.numeric", "_frombuffer"): "frombuffer" for core in ("core", "_core")},
    ("numpy", "ndarray"): "ndarray",
    ("numpy", "dtype"): "dtype",
    **{(f"scipy.sparse{module}", f"csc_{kind}"): "csc" for module in (".csc", "._csc") for kind in ("matrix", "array")},
    **{(module, "_reconstructor"): "object" for module in ("copy_reg", "copyreg")},
    **{(module, name): name for module in ("__builtin__", "builtins") for name in ("object", "set", "bytes")},
    ("_codecs", "encode"): "encode",
    ("collections", "OrderedDict"): "mapping",
}
_CHUMPY_PREFIX: Final = "chumpy."
_NUMBER_KINDS: Final = "fiub"
_REFUSED_OPCODES: Final = (
    *(pickle.PERSID, pickle.BINPERSID, pickle.EXT1, pickle.EXT2, pickle.EXT4, pickle.INST, pickle.OBJ),
    *(pickle.NEXT_BUFFER, pickle.READONLY_BUFFER, pickle.NEWOBJ_EX),
)


@final
@dataclass(slots=True, eq=False, repr=False)  # shown at length, a record within records could fill the memory
class Record:
    """A name of the allow-list with what a pickle called it with; inert."""

    kind: str  # what the name means here
    name: str  # as the pickle spells it
    arguments: tuple[Any, ...] | None = None  # of the call; None for the bare name
    state: Any = None  # what the pickle wanted to set


class _RefusedError(Exception):
    """The pickle asks for something that is not on the allow-list."""


@final
class _Reader(pickle._Unpickler):
    """Python's own interpreter of pickles (not the C one, which allocates what a file declares), with fewer opcodes."""

    dispatch: ClassVar[dict[int, Any]] = dict(pickle._Unpickler.dispatch)

    def find_class(self, module: str, name: str) -> Any:
        """Makes a record of an allowed name."""
        kind = _ALLOWED.get((module, name), "chumpy" if module.startswith(_CHUMPY_PREFIX) else "")
        if not kind:
            raise _RefusedError(f"{module}.{name}")
        return Record(kind, f"{module}.{name}")

    def load_reduce(self) -> None:
        """Records a call instead of making it."""
        stack: list[Any] = self.stack  # type: ignore[attr-defined]
        arguments, function = stack.pop(), stack.pop()
        stack.append(_called(function, arguments))

    def load_build(self) -> None:
        """Records a state instead of setting it."""
        stack: list[Any] = self.stack  # type: ignore[attr-defined]
        state, record = stack.pop(), stack[-1]
        if not isinstance(record, Record) or record.arguments is None:
            raise _RefusedError(f"a state for {type(record).__name__}")
        record.state = state

    def load_bytearray8(self) -> None:
        """Reads bytes without making room for a declared number of them first."""
        read: Callable[[int], bytes] = self.read  # type: ignore[attr-defined]
        n_bytes = int.from_bytes(read(8), "little")
        content = read(n_bytes)
        if len(content) != n_bytes:
            raise EOFError(f"{n_bytes} bytes declared, {len(content)} left")
        stack: list[Any] = self.stack  # type: ignore[attr-defined]
        stack.append(content)

    def refuse(self) -> None:
        """Refuses an opcode that files of arrays do not need."""
        raise _RefusedError("an opcode that pickles of arrays do not need")

    dispatch[pickle.BYTEARRAY8[0]] = load_bytearray8
    dispatch[pickle.REDUCE[0]] = load_reduce
    dispatch[pickle.NEWOBJ[0]] = load_reduce
    dispatch[pickle.BUILD[0]] = load_build
    for _opcode in _REFUSED_OPCODES:
        dispatch[_opcode[0]] = refuse


def read_pickle(path: Path) -> dict[str, Any]:
    """Reads a pickled dictionary; values stay records until ``as_array`` looks at them.

    Raises:
        InputFileError: Not a pickle of a dictionary, a damaged one, or one that asks for a name outside the list.
    """
    try:
        content = io.BytesIO(path.read_bytes())
        found = _Reader(content, encoding="latin1").load()
    except _RefusedError as error:
        raise InputFileError(
            f"{path}: expected a pickle of arrays, found one that asks for {error}; it was not given, and nothing "
            "of the file was run. If the file comes from the makers of the model, report this"
        ) from error
    except Exception as error:
        raise InputFileError(
            f"{path}: expected a pickle, found a file that cannot be read as one ({type(error).__name__}: {error})"
        ) from error
    found = found.state if isinstance(found, Record) and isinstance(found.state, dict) else found
    if not isinstance(found, dict):
        raise InputFileError(f"{path}: expected a pickled dictionary, found {type(found).__name__}")
    return {str(key): value for key, value in found.items()}


def as_array(value: Any, where: str) -> ndarray:
    """Makes an array of numbers from a record that ``read_pickle`` returned; ``where`` (file and key) is for messages.

    Raises:
        InputFileError: The record is not an array of numbers, or its size does not fit its data.
    """
    try:
        return _as_array(value, depth=0)
    except Exception as error:
        raise InputFileError(f"{where}: expected an array of numbers, found none ({error})") from error


def _called(function: Any, arguments: Any) -> Any:
    if not isinstance(function, Record) or function.arguments is not None or not isinstance(arguments, tuple):
        raise _RefusedError(f"a call of {getattr(function, 'name', type(function).__name__)}")
    if function.kind == "encode":  # how Python 3 writes bytes for Python 2
        return str(arguments[0]).encode("latin1")
    if function.kind == "set":
        return set()  # members do not matter: chumpy's bookkeeping
    if function.kind == "bytes":
        return b""  # how protocol 2 writes them when empty
    if function.kind == "mapping":
        return {}
    if function.kind == "object":  # copy_reg._reconstructor(class, base, state): an instance of the class
        function = arguments[0]
        if not isinstance(function, Record):
            raise _RefusedError(f"an object of {type(function).__name__}")
    return Record(function.kind, function.name, arguments)


def _as_array(value: Any, depth: int) -> ndarray:
    if depth > 8:
        raise ValueError("containers within containers")
    if not isinstance(value, Record):
        array = np.asarray(value)
        if array.dtype.kind not in _NUMBER_KINDS:
            raise ValueError(f"{type(value).__name__}")
        return array
    if value.kind == "array":
        return _from_array_state(value.state)
    if value.kind == "frombuffer" and value.arguments:  # protocol 5
        data, dtype, shape, order = value.arguments
        return _from_array_state((1, shape, dtype, order == "F", data))
    if value.kind == "scalar" and value.arguments:
        return np.frombuffer(_as_bytes(value.arguments[1]), dtype=_as_dtype(value.arguments[0]), count=1).reshape(())
    if value.kind == "chumpy" and isinstance(value.state, dict):
        return _from_chumpy(value, depth)
    raise ValueError(value.name)


def _from_chumpy(value: Record, depth: int) -> ndarray:
    if value.name == "chumpy.ch.Ch":
        return _as_array(value.state["x"], depth + 1)
    if value.name == "chumpy.reordering.Select":
        source, places = (_as_array(value.state[key], depth + 1) for key in ("a", "idxs"))
        chosen = source.ravel()[places]
        shape = value.state.get("preferred_shape")
        return chosen if shape is None else chosen.reshape(tuple(int(size) for size in _as_array(shape, depth + 1)))
    raise ValueError(f"the unevaluated expression {value.name}")


def _from_array_state(state: Any) -> ndarray:
    """NumPy's own state of an array: version, shape, dtype, column order, data."""
    _, shape, dtype_record, is_fortran, data = state
    dtype, content = _as_dtype(dtype_record), _as_bytes(data)
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(content):
        raise ValueError(f"shape {tuple(shape)} with {len(content)} bytes of data")
    return np.frombuffer(content, dtype=dtype).reshape(shape, order="F" if is_fortran else "C")


def _as_dtype(record: Any) -> np.dtype[Any]:
    if not isinstance(record, Record) or record.kind != "dtype" or not record.arguments:
        raise ValueError("an array without a type")
    order = record.state[1] if record.state else "="
    dtype = np.dtype(str(record.arguments[0]))
    if dtype.kind not in _NUMBER_KINDS or order not in "<>|=":
        raise ValueError(f"an array of {dtype}")
    return np.dtype(f"{order}{dtype.kind}{dtype.itemsize}") if order in "<>" else dtype


def _as_bytes(data: Any) -> bytes:
    if isinstance(data, str):  # Python 2's strings, read as latin1
        return data.encode("latin1")
    if not isinstance(data, bytes):
        raise TypeError(f"data of type {type(data).__name__}")
    return data
