"""Reads the numbers in small MAT 5 files: little-endian, plain or compressed, every type of number, nothing else.

SciPy's reader serves everything that Matlab can store and takes three times as long for the few kilobytes of a
coefficient file; with 122,450 of them that counts (``tests/benchmarks/mat5.py``). It also believes every size that a
file declares. Here a size is held against what is there before anything is made, and what a compressed element may
become is bounded. What this reader accepts it reads as SciPy does, bit for bit; text, structures, cells, complex and
sparse arrays are passed over, and refused by name where they were asked for.

Source: MathWorks, MAT-File Format, Version 5.
"""

import math
import struct
import zlib
from collections.abc import Collection
from functools import lru_cache
from typing import Any, NamedTuple, final

import numpy as np
from numpy import ndarray

from pix2face.errors import InputFileError

# No array of the files that are read here comes near this.
LARGEST_ELEMENT_BYTES = 1 << 20
# Compressed variables up to this size are inflated in one go: deflate makes at most 1,032 times as much of them (4 MB).
SMALL_BYTES = 4096
MAX_DIMENSIONS = 32

_WINDOW = zlib.MAX_WBITS
_HEADER_BYTES = 128
_VERSION = slice(124, 128)
_LITTLE_ENDIAN_5 = b"\0\1IM"
_MATRIX, _COMPRESSED = 14, 15
_UINT32, _INT32, _INT8 = 6, 5, 1
_NUMBER_TYPES: dict[int, np.dtype[Any]] = {
    1: np.dtype("<i1"),
    2: np.dtype("<u1"),
    3: np.dtype("<i2"),
    4: np.dtype("<u2"),
    5: np.dtype("<i4"),
    6: np.dtype("<u4"),
    7: np.dtype("<f4"),
    9: np.dtype("<f8"),
    12: np.dtype("<i8"),
    13: np.dtype("<u8"),
}
_CLASS_NAMES = {1: "a cell array", 2: "a structure", 3: "an object", 4: "text", 5: "a sparse array"}
_NUMBER_CLASSES = range(6, 16)
_COMPLEX = 0x0800

_TAG = struct.Struct("<II")
# Tag, flags, shape in two dimensions, and the tag of the name (8 + 16 + 16 + 8 bytes).
_PREFIX_BYTES = 48
# Tag, flags, shape in 32 dimensions, a name of 63 letters (Matlab's longest), the tag of the numbers.
_LONGEST_HEADER_BYTES = 8 + 16 + 136 + 72 + 8


class _DamagedError(Exception):
    """What is wrong, without the name of the file."""


def read_mat5(content: bytes, wanted: Collection[str], where: str) -> dict[str, ndarray]:
    """Reads named arrays of numbers.

    Args:
        content: The file.
        wanted: Names of variables. Those that the file lacks are missing in the answer.
        where: Name of the file in messages.

    Returns:
        Arrays in Matlab's shapes, read-only.

    Raises:
        InputFileError: No MAT 5 file, another byte order, a damaged one, or a wanted variable is no array of numbers.
    """
    try:
        if content[_VERSION] != _LITTLE_ENDIAN_5:
            raise _DamagedError(_foreign(content))
        return _read_elements(content, wanted, [])
    except (_DamagedError, struct.error, zlib.error) as error:
        raise InputFileError(
            f"{where}: expected a MAT 5 file of numbers, found one that cannot be read ({error}); "
            "download or save it again (Matlab: save -v6 or -v7)"
        ) from error


def names_in_mat5(content: bytes) -> list[str]:
    """Names of the variables of a file that ``read_mat5`` accepts; empty for objects, which have none here."""
    names: list[str] = []
    _read_elements(content, (), names)
    return names


def _foreign(content: bytes) -> str:
    header = content[:_HEADER_BYTES]
    if len(header) < _HEADER_BYTES:
        return f"{len(header)} bytes, too short for its header"
    if header.endswith(b"MI"):
        return "the byte order is big-endian"
    return "the file is MAT 7.3 (HDF5)" if header[_VERSION] == b"\0\2IM" else "no header of Matlab"


def _read_elements(content: bytes, wanted: Collection[str], others: list[str]) -> dict[str, ndarray]:
    # A hundred thousand files pass through here: the plain case stands in line.
    arrays: dict[str, ndarray] = {}
    offset, end = _HEADER_BYTES, len(content)
    unpack, inflate, parsed, header_bytes = _TAG.unpack_from, zlib.decompress, _parsed, _header_bytes
    while offset < end:
        kind, size = unpack(content, offset)
        start, offset = offset + 8, offset + 8 + size
        if offset > end:
            raise _DamagedError(f"cut off: an element declares {size} bytes, {end - start} are left")
        if kind == _COMPRESSED:
            if size <= SMALL_BYTES:
                element = inflate(content[start:offset], _WINDOW, SMALL_BYTES)
            else:
                element = _inflated(content[start:offset], wanted)
        elif kind == _MATRIX:
            element = content[start - 8 : offset]
        else:
            raise _DamagedError(f"a variable of the unknown kind {kind}")
        name, problem, shape, dtype, strides, begin, stop = parsed(element[: header_bytes(element[:_PREFIX_BYTES])])
        if name not in wanted:
            others.append(name)
        elif name not in arrays:
            if problem or stop > len(element):
                raise _DamagedError(problem or f"{name} is cut off")
            arrays[name] = ndarray(shape, dtype, element, begin, strides)
    return arrays


def _inflated(compressed: bytes, wanted: Collection[str]) -> bytes:
    """A large variable without its compression; of one that nobody wants, the beginning."""
    inflater = zlib.decompressobj()
    element = inflater.decompress(compressed, SMALL_BYTES)
    if inflater.eof or _parsed(element[: _header_bytes(element[:_PREFIX_BYTES])]).name not in wanted:
        return element
    element += inflater.decompress(inflater.unconsumed_tail, LARGEST_ELEMENT_BYTES)
    if not inflater.eof:
        raise _DamagedError(f"a variable is cut off or larger than {LARGEST_ELEMENT_BYTES} bytes")
    return element


@final
class _Header(NamedTuple):
    """What precedes the numbers of a variable.

    Attributes:
        name: Of the variable; empty for classes of objects, which have none here.
        problem: Why it cannot be read as an array of numbers, or empty.
        shape: Its shape.
        dtype: Of the numbers as they are stored.
        strides: Column by column, as Matlab stores them.
        start: Where they begin in the element, its tag included.
        end: Where they end.
    """

    name: str
    problem: str = ""
    shape: tuple[int, ...] = ()
    dtype: np.dtype[Any] = _NUMBER_TYPES[1]
    strides: tuple[int, ...] = ()
    start: int = 0
    end: int = 0


# The headers of a data set repeat from file to file: each is parsed once.
@lru_cache(maxsize=256)
def _header_bytes(prefix: bytes) -> int:
    """Where the tag of a variable's numbers ends, seen from its first bytes."""
    kind, _ = _TAG.unpack_from(prefix)
    if kind != _MATRIX:
        raise _DamagedError(f"a variable of the unknown kind {kind}")
    _, _, _, offset = _read_tag(prefix, 8)
    _, _, _, offset = _read_tag(prefix, offset)
    if offset + 8 > _PREFIX_BYTES:
        return _LONGEST_HEADER_BYTES
    return min(_read_tag(prefix, offset)[3] + 8, _LONGEST_HEADER_BYTES)


@lru_cache(maxsize=256)
def _parsed(header: bytes) -> _Header:
    kind, start, n_bytes, offset = _read_tag(header, 8)
    if kind != _UINT32 or n_bytes != 8:
        raise _DamagedError("a variable without flags")
    flags = int.from_bytes(header[start : start + 4], "little")
    matlab_class = flags & 0xFF
    if not 1 <= matlab_class <= _NUMBER_CLASSES[-1]:
        return _Header("")
    kind, start, n_bytes, offset = _read_tag(header, offset)
    if kind != _INT32 or n_bytes % 4 or not 8 <= n_bytes <= 4 * MAX_DIMENSIONS:
        raise _DamagedError("a variable without a shape")
    shape = struct.unpack_from(f"<{n_bytes // 4}i", header, start)
    kind, start, n_bytes, offset = _read_tag(header, offset)
    if kind != _INT8 or start + n_bytes > len(header):
        raise _DamagedError("a variable without a name, or with a very long one")
    name = header[start : start + n_bytes].decode("latin-1")
    if matlab_class not in _NUMBER_CLASSES or flags & _COMPLEX:
        found = _CLASS_NAMES.get(matlab_class, "complex numbers")
        return _Header(name, f"{name} should be an array of numbers and is {found}")
    return _with_numbers(header, offset, name, shape)


def _with_numbers(header: bytes, offset: int, name: str, shape: tuple[int, ...]) -> _Header:
    if len(header) < offset + 8:
        return _Header(name, f"{name} is cut off")
    kind, start, n_bytes, _ = _read_tag(header, offset)
    dtype = _NUMBER_TYPES.get(kind)
    if dtype is None:
        return _Header(name, f"{name} holds numbers of the unknown type {kind}")
    if min(shape) < 0 or math.prod(shape) * dtype.itemsize != n_bytes:
        return _Header(name, f"{name} of shape {shape} and type {dtype} declares {n_bytes} bytes")
    strides = tuple(dtype.itemsize * math.prod(shape[:axis]) for axis in range(len(shape)))
    return _Header(name, "", shape, dtype, strides, start, start + n_bytes)


def _read_tag(element: bytes, offset: int) -> tuple[int, int, int, int]:
    """Type, start and length of a data element, and where the next one begins (elements are padded to 8 bytes)."""
    kind, n_bytes = _TAG.unpack_from(element, offset)
    if kind >> 16:  # a small element: type and length share a word, up to 4 bytes follow
        kind, n_bytes = kind & 0xFFFF, kind >> 16
        if n_bytes > 4:
            raise _DamagedError(f"a small element of {n_bytes} bytes")
        return kind, offset + 4, n_bytes, offset + 8
    start = offset + 8
    return kind, start, n_bytes, start + n_bytes + -n_bytes % 8
