"""Reads pickles of arrays without letting them run anything: no class and no function of a pickle is ever resolved.

A pickle is a program. This reader knows a small part of its language, and the few names that files of FLAME mention
(NumPy arrays, SciPy's sparse columns, chumpy's containers) become inert records of what they were given. Arrays are
made afterwards, from records whose sizes were checked. Any other name is refused, and the message tells which.

A pickle may refer to what it has made already, so that some hundred bytes describe a list of lists of lists with more
elements than any memory holds. So operations are counted while it is read, references are counted when they are
followed, and nothing is hashed, compared or printed but text and small numbers.
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
from pix2face.files.opening import read_regular

# FLAME has 0.1 GB and some thousand operations; each operation takes at most some hundred bytes of memory.
LARGEST_FILE_BYTES = 256 << 20
MOST_OPERATIONS = 1_000_000
LARGEST_ARRAY_BYTES = 512 << 20
LONGEST_NAME = 200
_ELEMENT_BYTES, _MOST_LEVELS, _MOST_DIMENSIONS = 512, 8, 32

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


def _counted(operation: Callable[[Any], None]) -> Callable[[Any], None]:
    def run(reader: Any) -> None:
        reader.operations.spend(1)
        operation(reader)

    return run


def _checked_key(key: Any) -> Any:
    """Keys are hashed, which takes as long as they have parts, and a stack as deep."""
    if isinstance(key, str | bytes) or (isinstance(key, int) and abs(key) < 1 << 63):
        return key
    raise ValueError(f"a key of type {type(key).__name__}, or a very large one")


def _dictionary(items: list[Any]) -> dict[Any, Any]:
    return {_checked_key(key): value for key, value in zip(items[::2], items[1::2], strict=True)}


@final
class _Budget:
    """What may still be made, in operations or bytes."""

    def __init__(self, amount: int, what: str) -> None:
        self._left, self._amount, self._what = amount, amount, what

    def spend(self, amount: int) -> None:
        """Raises ValueError where there is not so much left."""
        self._left -= amount
        if self._left < 0:
            raise ValueError(f"more than {self._amount} {self._what}")


@final
class _Reader(pickle._Unpickler):
    """Python's own interpreter of pickles (not the C one, which allocates what a file declares), with fewer opcodes."""

    dispatch: ClassVar[dict[int, Any]] = dict(pickle._Unpickler.dispatch)

    def __init__(self, content: bytes) -> None:
        super().__init__(io.BytesIO(content), encoding="latin1")
        self.operations = _Budget(MOST_OPERATIONS, "operations")
        self.made = _Budget(LARGEST_ARRAY_BYTES, "bytes of text")

    def find_class(self, module: str, name: str) -> Any:
        """Makes a record of an allowed name."""
        kind = _ALLOWED.get((module, name), "chumpy" if module.startswith(_CHUMPY_PREFIX) else "")
        if not kind:
            raise _RefusedError(f"{module}.{name}"[:LONGEST_NAME])
        return Record(kind, f"{module}.{name}")

    def load_reduce(self) -> None:
        """Records a call instead of making it."""
        stack: list[Any] = self.stack  # type: ignore[attr-defined]
        arguments, function = stack.pop(), stack.pop()
        stack.append(_called(function, arguments, self.made))

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

    def load_setitem(self) -> None:
        """Sets one value of a dictionary."""
        stack: list[Any] = self.stack  # type: ignore[attr-defined]
        value, key = stack.pop(), stack.pop()
        stack[-1][_checked_key(key)] = value

    def load_setitems(self) -> None:
        """Sets several values of a dictionary."""
        items = self.pop_mark()  # type: ignore[attr-defined]
        self.stack[-1].update(_dictionary(items))  # type: ignore[attr-defined]

    def load_dict(self) -> None:
        """Makes a dictionary."""
        items = self.pop_mark()  # type: ignore[attr-defined]
        self.append(_dictionary(items))  # type: ignore[attr-defined]

    def load_additems(self) -> None:
        """Leaves out the members of a set: they do not matter, and would be hashed."""
        self.pop_mark()  # type: ignore[attr-defined]

    def load_frozenset(self) -> None:
        """Makes an empty set, as `load_additems`."""
        self.pop_mark()  # type: ignore[attr-defined]
        self.append(frozenset())  # type: ignore[attr-defined]

    def refuse(self) -> None:
        """Refuses an opcode that files of arrays do not need."""
        raise _RefusedError("an opcode that pickles of arrays do not need")

    dispatch[pickle.BYTEARRAY8[0]] = load_bytearray8
    dispatch[pickle.REDUCE[0]] = load_reduce
    dispatch[pickle.NEWOBJ[0]] = load_reduce
    dispatch[pickle.BUILD[0]] = load_build
    dispatch[pickle.SETITEM[0]] = load_setitem
    dispatch[pickle.SETITEMS[0]] = load_setitems
    dispatch[pickle.DICT[0]] = load_dict
    dispatch[pickle.ADDITEMS[0]] = load_additems
    dispatch[pickle.FROZENSET[0]] = load_frozenset
    for _opcode in _REFUSED_OPCODES:
        dispatch[_opcode[0]] = refuse
    dispatch = {opcode: _counted(operation) for opcode, operation in dispatch.items()}


def read_pickle(path: Path) -> dict[str, Any]:
    """Reads a pickled dictionary; values stay records until ``as_array`` looks at them.

    Raises:
        InputFileError: Not a pickle of a dictionary, a damaged one, or one that asks for a name outside the list.
    """
    content = read_regular(path, "a pickle of arrays", LARGEST_FILE_BYTES)
    try:
        found = _Reader(content).load()
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
    return {key: value for key, value in found.items() if isinstance(key, str)}


def as_array(value: Any, where: str) -> ndarray:
    """Makes an array of numbers from a record that ``read_pickle`` returned; ``where`` (file and key) is for messages.

    Raises:
        InputFileError: The record is not an array of numbers, or its size does not fit its data.
    """
    try:
        return _as_array(value, _Budget(LARGEST_ARRAY_BYTES, "bytes"), depth=0)
    except Exception as error:
        raise InputFileError(f"{where}: expected an array of numbers, found none ({error})") from error


def _called(function: Any, arguments: Any, made: _Budget) -> Any:
    if not isinstance(function, Record) or function.arguments is not None or not isinstance(arguments, tuple):
        name = function.name if isinstance(function, Record) else type(function).__name__
        raise _RefusedError(f"a call of {name[:LONGEST_NAME]}")
    if function.kind == "encode":  # how Python 3 writes bytes for Python 2
        return _as_bytes(_text(arguments[0]), made)
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


def _as_array(value: Any, budget: _Budget, depth: int) -> ndarray:
    if depth > _MOST_LEVELS:
        raise ValueError("containers within containers")
    if not isinstance(value, Record):
        array = np.asarray(_numbers(value, budget, depth))
        if array.dtype.kind not in _NUMBER_KINDS:
            raise ValueError(f"{type(value).__name__}")
        return array
    if value.kind == "array":
        return _from_array_state(value.state, budget)
    if value.kind == "frombuffer" and value.arguments:  # protocol 5
        data, dtype, shape, order = value.arguments
        return _from_array_state((1, shape, dtype, order == "F", data), budget)
    if value.kind == "scalar" and value.arguments:
        data = _as_bytes(value.arguments[1], budget)
        return np.frombuffer(data, dtype=_as_dtype(value.arguments[0]), count=1).reshape(())
    if value.kind == "chumpy" and isinstance(value.state, dict):
        return _from_chumpy(value, budget, depth)
    raise ValueError(value.name[:LONGEST_NAME])


def _numbers(value: Any, budget: _Budget, depth: int) -> Any:
    """A number, or lists of numbers, each counted as often as it is referred to."""
    if isinstance(value, int | float):
        return value
    if not isinstance(value, list | tuple) or depth > _MOST_LEVELS:
        raise ValueError(f"{type(value).__name__}")
    budget.spend(_ELEMENT_BYTES * (1 + len(value)))
    return [_numbers(child, budget, depth + 1) for child in value]


def _from_chumpy(value: Record, budget: _Budget, depth: int) -> ndarray:
    if value.name == "chumpy.ch.Ch":
        return _as_array(value.state["x"], budget, depth + 1)
    if value.name == "chumpy.reordering.Select":
        source, places = (_as_array(value.state[key], budget, depth + 1) for key in ("a", "idxs"))
        budget.spend(places.size * source.itemsize + source.nbytes)
        chosen = source.ravel()[places]
        shape = value.state.get("preferred_shape")
        return chosen if shape is None else chosen.reshape(_shape(_as_array(shape, budget, depth + 1).tolist()))
    raise ValueError(f"the unevaluated expression {value.name[:LONGEST_NAME]}")


def _from_array_state(state: Any, budget: _Budget) -> ndarray:
    """NumPy's own state of an array: version, shape, dtype, column order, data."""
    _, lengths, dtype_record, is_fortran, data = state
    shape, dtype, content = _shape(lengths), _as_dtype(dtype_record), _as_bytes(data, budget)
    if math.prod(shape) * dtype.itemsize != len(content):
        raise ValueError(f"shape {shape} with {len(content)} bytes of data")
    return np.frombuffer(content, dtype=dtype).reshape(shape, order="F" if is_fortran else "C")


def _shape(lengths: Any) -> tuple[int, ...]:
    if not isinstance(lengths, list | tuple) or len(lengths) > _MOST_DIMENSIONS:
        raise TypeError(f"a shape of type {type(lengths).__name__}")
    if not all(isinstance(length, int) and 0 <= length < 1 << 48 for length in lengths):
        raise ValueError("a shape of other things than lengths")
    return tuple(lengths)


def _as_dtype(record: Any) -> np.dtype[Any]:
    if not isinstance(record, Record) or record.kind != "dtype" or not record.arguments:
        raise ValueError("an array without a type")
    order = record.state[1] if record.state else "="
    dtype = np.dtype(_text(record.arguments[0])[:LONGEST_NAME])
    if dtype.kind not in _NUMBER_KINDS or not isinstance(order, str) or order not in "<>|=":
        raise ValueError(f"an array of {dtype}")
    return np.dtype(f"{order}{dtype.kind}{dtype.itemsize}") if order in "<>" else dtype


def _as_bytes(data: Any, budget: _Budget) -> bytes:
    if isinstance(data, str):  # Python 2's strings, read as latin1
        budget.spend(len(data))
        return data.encode("latin1")
    if not isinstance(data, bytes):
        raise TypeError(f"data of type {type(data).__name__}")
    return data


def _text(value: Any) -> str:
    """Text, and nothing that would first have to be written as text."""
    if not isinstance(value, str):
        raise TypeError(f"text of type {type(value).__name__}")
    return value
