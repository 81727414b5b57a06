"""Arrays of numbers from MAT files of version 5, one variable at a time, and of version 7.3, which are HDF5.

The fields of a structure are named as in Matlab: ``model.shapeMU``.

SciPy believes what a file says of itself: a damaged type code ends the process, and a declared size is allocated
(52 of 12,000 damaged coefficient files crashed SciPy 1.17). Here kind, shape and size of an array are held against
each other, and against what the file can hold at deflate's best, before memory is taken.

Source: MathWorks, MAT-File Format, Version 5.
"""

import math
import os
import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, final

import h5py
import numpy as np
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.checked_hdf5 import open_hdf5, read_array
from pix2face.files.opening import largest_unfolded, open_regular

# The Basel Face Model of 2009 takes 0.25 GB.
LARGEST_FILE_BYTES = 1 << 30
_HEADER_BYTES = 128
_MAT5_ENDS, _MAT73_END = (b"\x00\x01IM", b"\x01\x00MI"), b"\x00\x02IM"
_TWO_WORDS = {order: struct.Struct(f"{order}II") for order in "<>"}
_STRUCTURE = "a structure"
_INT32, _MATRIX, _COMPRESSED = 5, 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_OTHER_CLASSES = {1: "a cell array", 2: _STRUCTURE, 3: "an object", 4: "text", 5: "a sparse array"}
_LAST_NUMBER_CLASS = 15
_COMPLEX = 0x0800
_MAX_DIMENSIONS = 32
_MOST_VARIABLES, _LONGEST_NAME = 10_000, 64
_CHUNK_BYTES = 1 << 20
# Kind, flags, shape and name of any variable that Matlab writes (32 dimensions, 63 letters) fit.
_FIRST_BYTES = 512


class _DamagedError(Exception):
    """What is wrong, without the name of the file."""


def is_mat(start: bytes) -> bool:
    """Whether the first 128 bytes of a file are those of a MAT file."""
    return start[124:128] in (*_MAT5_ENDS, _MAT73_END)


def mat_names(path: Path) -> list[str]:
    """Names of all variables.

    Raises:
        InputFileError: As `read_mat`.
    """
    with _opened(path, LARGEST_FILE_BYTES) as (header, file):
        if header[124:] != _MAT73_END:
            return [variable.name for variable in _variables(header, file)]
    with open_hdf5(path) as datasets:
        return list(_datasets(datasets))


def read_mat(path: Path, wanted: Collection[str], largest_bytes: int = LARGEST_FILE_BYTES) -> dict[str, ndarray]:
    """Reads arrays by their names, in Matlab's shapes and stored types. Those that the file lacks are left out.

    Of several variables with one name, the first counts. Files larger than ``largest_bytes`` are not read.

    Raises:
        InputFileError: The file is missing, damaged, hostile or of another format, or a wanted variable is larger than
            ``largest_bytes`` or not a full array of real numbers.
    """
    arrays: dict[str, ndarray] = {}
    with _opened(path, largest_bytes) as (header, file):
        if header[124:] != _MAT73_END:
            for variable in _variables(header, file):
                if variable.name in wanted and variable.name not in arrays:
                    arrays[variable.name] = variable.read(largest_bytes)
            return arrays
    with open_hdf5(path) as datasets:
        names = _datasets(datasets)
        # Matlab counts dimensions from the other end than HDF5.
        return {name: read_array(datasets, names[name], path).T for name in names if name in wanted}


def _datasets(file: h5py.File) -> dict[str, str]:
    """From the names of variables and fields to those of their datasets."""
    found: dict[str, str] = {}
    for name, item in file.items():
        if isinstance(item, h5py.Dataset):
            found[name] = name
        elif isinstance(item, h5py.Group):
            fields = (key for key, field in item.items() if isinstance(field, h5py.Dataset))
            found |= {f"{name}.{key}": f"{name}/{key}" for key in fields}
    return found


@contextmanager
def _opened(path: Path, largest_bytes: int) -> Iterator[tuple[bytes, BinaryIO]]:
    """Opens a MAT file and yields its header, and the file at its first variable.

    Errors in reading it become one `InputFileError` that names the file.
    """
    with open_regular(path, "a MAT file of numbers", largest_bytes) as file:
        try:
            yield file.read(_HEADER_BYTES), file
        except (_DamagedError, OSError, struct.error, zlib.error, UnicodeDecodeError) as error:
            raise InputFileError(
                f"{path}: expected a MAT 5 file of numbers, found one that cannot be read ({error}); "
                "download or save it again (Matlab: save -v6 or -v7)"
            ) from error


def _variables(header: bytes, file: BinaryIO) -> "Iterator[_Variable]":
    """The variables in their order; each can be read until the next is asked for."""
    if header[124:] not in _MAT5_ENDS:
        is_short = len(header) < _HEADER_BYTES
        raise _DamagedError(f"{len(header)} bytes, too short for its header" if is_short else "no header of Matlab")
    order, at, size = "<" if header[126:128] == b"IM" else ">", _HEADER_BYTES, os.fstat(file.fileno()).st_size
    for _ in range(_MOST_VARIABLES):
        if at >= size:
            return
        file.seek(at)
        kind, n_bytes = _unpack(order, file.read(8))
        at += 8 + n_bytes
        if at > size:
            raise _DamagedError(f"cut off: an element declares {n_bytes} bytes, {size - at + n_bytes} are left")
        body = _Body(file, n_bytes, is_compressed=kind == _COMPRESSED)
        start = body.read(_FIRST_BYTES)
        if kind == _COMPRESSED:
            kind, _ = _unpack(order, start[:8])
            del start[:8]
        if kind != _MATRIX:
            raise _DamagedError(f"a variable of the unknown kind {kind}")
        variable = _parsed(order, start, body)
        yield variable
        if variable.kind == _STRUCTURE and math.prod(variable.shape) == 1:
            yield from _fields(variable)
    raise _DamagedError(f"more than {_MOST_VARIABLES} variables")


def _fields(structure: "_Variable") -> "Iterator[_Variable]":
    """The fields of a structure, one after the other in its element."""
    order, rest = structure.order, _Part(structure.body, structure.body.limit, structure.start)
    _, _, length = _tag(order, rest.read(8))
    name_bytes = int.from_bytes(length, "little" if order == "<" else "big")
    _, n_bytes, inline = _tag(order, rest.read(8))
    if not 0 < name_bytes <= _LONGEST_NAME or n_bytes > name_bytes * _MOST_VARIABLES:
        raise _DamagedError(f"the names of {n_bytes} bytes of the fields of {structure.name}")
    names = inline or rest.read(n_bytes + -n_bytes % 8)[:n_bytes]
    for at in range(0, len(names) - name_bytes + 1, name_bytes):
        kind, n_bytes = _unpack(order, rest.read(8))
        if kind != _MATRIX:
            raise _DamagedError(f"a field of {structure.name} of the unknown kind {kind}")
        body = _Part(rest, n_bytes)
        field = names[at : at + name_bytes].split(b"\0")[0].decode("ascii")
        if n_bytes:  # Matlab writes nothing for some empty arrays
            yield replace(_parsed(order, body.read(_FIRST_BYTES), body), name=f"{structure.name}.{field}")
        body.skip()


@final
class _Body:
    """The content of one element, inflated where it is compressed, read from front to back."""

    def __init__(self, file: BinaryIO, n_bytes: int, *, is_compressed: bool) -> None:
        self._file, self._left = file, n_bytes
        self._inflater = zlib.decompressobj() if is_compressed else None
        self.limit = largest_unfolded(n_bytes) if is_compressed else n_bytes  # no more bytes can come out

    def read(self, n_bytes: int) -> bytearray:
        """Up to that number of bytes; memory grows with what is there, not with what was asked for."""
        if self._inflater is None:
            return bytearray(self._raw(n_bytes))
        out = bytearray()
        while len(out) < n_bytes and not self._inflater.eof:
            packed = self._inflater.unconsumed_tail or self._raw(_CHUNK_BYTES)
            fresh = self._inflater.decompress(packed, n_bytes - len(out))
            if not packed and not fresh:
                break
            out += fresh
        return out

    def _raw(self, n_bytes: int) -> bytes:
        content = self._file.read(min(n_bytes, self._left))
        self._left -= len(content)
        return content


@final
class _Part:
    """An element inside of another one, read from front to back; what was read of it already comes first."""

    def __init__(self, whole: "_Body | _Part", n_bytes: int, start: bytearray | None = None) -> None:
        self._whole, self._start, self._left = whole, start or bytearray(), n_bytes
        self.limit: int = min(whole.limit, n_bytes)

    def read(self, n_bytes: int) -> bytearray:
        """As `_Body.read`."""
        wanted = min(n_bytes, self._left)
        out, self._start = self._start[:wanted], self._start[wanted:]
        out += self._whole.read(wanted - len(out))
        self._left -= len(out)
        return out

    def skip(self) -> None:
        """Goes to the end of the element."""
        while self.read(_CHUNK_BYTES):
            pass


@final
@dataclass(frozen=True, eq=False)
class _Variable:
    """What precedes the numbers of a variable, and what follows it."""

    name: str  # empty for objects, whose names stand elsewhere
    kind: str  # what it is, where it is no array of real numbers; else empty
    shape: tuple[int, ...]
    order: str  # of the bytes: "<" or ">"
    start: bytearray  # the tag of the numbers and their first bytes
    body: "_Body | _Part"  # what follows

    def read(self, largest_bytes: int) -> ndarray:
        """Reads the numbers."""
        if self.kind:
            raise _DamagedError(f"{self.name} should be an array of numbers and is {self.kind}")
        kind, n_bytes, inline = _tag(self.order, self.start[:8])
        limit = min(self.body.limit, largest_bytes)
        dtype = np.dtype(self.order + _TYPES.get(kind, "V0"))
        if kind not in _TYPES or math.prod(self.shape) * dtype.itemsize != n_bytes or n_bytes > limit:
            raise _DamagedError(
                f"{self.name} of shape {self.shape} declares {n_bytes} bytes of type {kind}, "
                f"at most {limit} are possible"
            )
        content = bytearray(inline) or self.start[8 : 8 + n_bytes]
        content += self.body.read(n_bytes - len(content))
        self.body.read(8)  # on to the end, where the checksum is
        if len(content) != n_bytes:
            raise _DamagedError(f"{self.name} is cut off")
        return np.frombuffer(content, dtype=dtype).reshape(self.shape, order="F")


def _parsed(order: str, start: bytearray, body: _Body | _Part) -> _Variable:
    """Flags, shape and name, from the first bytes of a variable: three elements, each padded to 8 bytes."""
    _, content, at = _element(order, start, 0)
    if len(content) != 8:
        raise _DamagedError("a variable without flags")
    (flags,) = struct.unpack_from(f"{order}I", content)
    matlab_class = flags & 0xFF
    if not 1 <= matlab_class <= _LAST_NUMBER_CLASS:
        return _Variable("", "an object", (), order, start, body)
    kind, content, at = _element(order, start, at)
    shape = struct.unpack(f"{order}{len(content) // 4}i", content)
    if kind != _INT32 or not 2 <= len(shape) <= _MAX_DIMENSIONS or min(shape) < 0:
        raise _DamagedError("a variable without a shape")
    _, content, at = _element(order, start, at)
    other = _OTHER_CLASSES.get(matlab_class, "complex numbers" if flags & _COMPLEX else "")
    return _Variable(content.decode("ascii"), other, shape, order, start[at:], body)


def _element(order: str, start: bytearray, at: int) -> tuple[int, bytearray, int]:
    """Type and content of a data element, and where the next one begins."""
    kind, n_bytes, inline = _tag(order, start[at : at + 8])
    if inline:
        return kind, inline, at + 8
    content = start[at + 8 : at + 8 + n_bytes]
    if len(content) != n_bytes:
        raise _DamagedError("a variable without a name, or with a very long one")
    return kind, content, at + 8 + n_bytes + -n_bytes % 8


def _tag(order: str, tag: bytearray) -> tuple[int, int, bytearray]:
    """Type, length and, of a small element, the content: type and length share a word then, up to 4 bytes follow."""
    kind, n_bytes = _unpack(order, tag)
    if kind >> 16:
        kind, n_bytes = kind & 0xFFFF, kind >> 16
        if n_bytes > 4:
            raise _DamagedError(f"a small element of {n_bytes} bytes")
        return kind, n_bytes, tag[4 : 4 + n_bytes]
    return kind, n_bytes, bytearray()


def _unpack(order: str, tag: bytes | bytearray) -> tuple[int, int]:
    kind, n_bytes = _TWO_WORDS[order].unpack(tag)
    return kind, n_bytes
