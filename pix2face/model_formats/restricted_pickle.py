"""Reads pickles of arrays without letting them run anything: no class and no function of a pickle is ever resolved.

A pickle is a program. This reader knows a small part of its language, and the few names that files of FLAME mention
(NumPy arrays, SciPy's sparse columns, chumpy's containers) become inert records of what they were given. Arrays are
made afterwards, from records whose sizes were checked. Any other name is refused, and the message tells which.

A pickle may refer to what it has made already, so that some hundred bytes describe a list of lists of lists with more
elements than any memory holds. So operations are counted while it is read, references are counted when they are
followed, and nothing is hashed, compared or printed but text and small numbers.
"""

import io
import pickle  # noqa: TID251 (only the names of opcodes and a subclass that resolves nothing)
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, final

from pix2face.errors import InputFileError
from pix2face.files.opening import read_regular

# FLAME has 0.1 GB and some thousand operations; each operation takes at most some hundred bytes of memory.
LARGEST_FILE_BYTES = 256 << 20
MOST_OPERATIONS = 1_000_000
LARGEST_ARRAY_BYTES = 512 << 20
LONGEST_NAME = 200

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
class Budget:
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
        self.operations = Budget(MOST_OPERATIONS, "operations")
        self.made = Budget(LARGEST_ARRAY_BYTES, "bytes of text")

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
    """Reads a pickled dictionary; values stay records until ``pickled_arrays.as_array`` looks at them.

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


def _called(function: Any, arguments: Any, made: Budget) -> Any:
    if not isinstance(function, Record) or function.arguments is not None or not isinstance(arguments, tuple):
        name = function.name if isinstance(function, Record) else type(function).__name__
        raise _RefusedError(f"a call of {name[:LONGEST_NAME]}")
    if function.kind == "encode":  # how Python 3 writes bytes for Python 2
        return latin1_bytes(checked_text(arguments[0]), made)
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


def latin1_bytes(data: Any, budget: Budget) -> bytes:
    """Bytes as pickles of either Python hold them.

    Raises:
        TypeError: It is something else.
        ValueError: The budget is spent.
    """
    if isinstance(data, str):  # Python 2's strings, read as latin1
        budget.spend(len(data))
        return data.encode("latin1")
    if not isinstance(data, bytes):
        raise TypeError(f"data of type {type(data).__name__}")
    return data


def checked_text(value: Any) -> str:
    """Text, and nothing that would first have to be written as text.

    Raises:
        TypeError: It is something else.
    """
    if not isinstance(value, str):
        raise TypeError(f"text of type {type(value).__name__}")
    return value
