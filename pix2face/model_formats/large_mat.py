"""Large arrays of numbers from MAT 5 files, read one variable at a time; small files have ``pix2face.face_files.mat5``.

SciPy believes every size that a file declares. Here the size of an array is held against its shape and against what
the file (or, at deflate's best, its compressed bytes) can hold before memory is taken.

Source: MathWorks, MAT-File Format, Version 5.
"""

import math
import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, final

import numpy as np
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.checked_hdf5 import LARGEST_ARRAY_BYTES, LARGEST_COMPRESSION

_HEADER_BYTES = 128
_MATRIX, _COMPRESSED = 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_NUMBER_CLASSES = range(6, 16)
_COMPLEX = 0x08  # in the second byte of the flags
_INT32 = 5
_MAX_DIMENSIONS = 32
_CHUNK_BYTES = 1 << 20
# Flags, shape and name of any variable that Matlab writes (32 dimensions, 63 letters) fit.
_FIRST_BYTES = 512


class _DamagedError(Exception):
    """What is wrong, without the name of the file."""


@final
@dataclass(frozen=True)
class _Variable:
    name: str
    is_number: bool
    shape: tuple[int, ...]
    data_at: int
    """Where the tag of the numbers begins, from the start of the flags."""


def is_mat5(content: bytes) -> bool:
    """Whether a file's first 128 bytes are those of a MAT 5 file."""
    return content[124:128] in (b"\x00\x01IM", b"\x01\x00MI")


def mat_names(path: Path) -> list[str]:
    """Names of all variables.

    Raises:
        InputFileError: As ``read_mat``.
    """
    with _reported(path):
        return [variable.name for variable, _ in _variables(path)]


def read_mat(path: Path, wanted: Collection[str]) -> dict[str, ndarray]:
    """Reads named arrays, in Matlab's shapes. Those that the file lacks are missing in the answer.

    Raises:
        InputFileError: No MAT 5 file, a damaged or hostile one, or a wanted variable is no real, full array of numbers.
    """
    with _reported(path):
        return {variable.name: read() for variable, read in _variables(path) if variable.name in wanted}


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    """Turns what may go wrong into one error that names the file."""
    try:
        yield
    except (_DamagedError, OSError, struct.error, zlib.error, UnicodeDecodeError) as error:
        raise InputFileError(
            f"{path}: expected a MAT 5 file of numbers, found one that cannot be read ({error})"
        ) from error


def _variables(path: Path) -> "Iterator[tuple[_Variable, _Numbers]]":
    """Each variable with what reads its numbers, as long as the file is open."""
    with path.open("rb") as file:
        header, size = file.read(_HEADER_BYTES), path.stat().st_size
        if not is_mat5(header):
            raise _DamagedError("it does not start as one; MAT 7.3 files: save again with -v7")
        order, at = "<" if header[126:128] == b"IM" else ">", _HEADER_BYTES
        while at < size:
            file.seek(at)
            kind, n_bytes = _unpack(order, file.read(8))
            if at + 8 + n_bytes > size:
                raise _DamagedError(f"cut off: {n_bytes} bytes declared at {at}, {size - at - 8} left")
            numbers = _Numbers(file, order, at + 8, n_bytes, kind)
            yield numbers.variable, numbers
            at += 8 + n_bytes


@final
class _Numbers:
    """One variable of an open file; called, it reads the numbers."""

    def __init__(self, file: BinaryIO, order: str, at: int, n_bytes: int, kind: int) -> None:
        self._file, self._order, self._at, self._n_bytes = file, order, at, n_bytes
        self._is_compressed = kind == _COMPRESSED
        self._limit = min(n_bytes * (LARGEST_COMPRESSION if self._is_compressed else 1), LARGEST_ARRAY_BYTES)
        body = self._body()
        if self._is_compressed:
            kind, _ = _unpack(order, body.read(8))
        if kind != _MATRIX:
            raise _DamagedError(f"a variable of the unknown kind {kind}")
        self.variable = _parsed(order, body.read(min(_FIRST_BYTES, self._limit)))

    def __call__(self) -> ndarray:
        """Reads the array.

        Raises:
            _DamagedError: It is no real, full array of numbers, or its sizes contradict each other.
        """
        variable = self.variable
        if not variable.is_number:
            raise _DamagedError(f"{variable.name} is no array of real numbers")
        body = self._body()
        body.read((8 if self._is_compressed else 0) + variable.data_at)
        kind, n_bytes, inline = _tag(self._order, body.read(8))
        dtype = np.dtype(self._order + _TYPES.get(kind, "V0"))
        if kind not in _TYPES or math.prod(variable.shape) * dtype.itemsize != n_bytes or n_bytes > self._limit:
            raise _DamagedError(
                f"{variable.name} of shape {variable.shape} declares {n_bytes} bytes of type {kind}, "
                f"at most {self._limit} are possible"
            )
        content = inline or body.read(n_bytes)
        if len(content) != n_bytes:
            raise _DamagedError(f"{variable.name} is cut off")
        return np.frombuffer(content, dtype=dtype).reshape(variable.shape, order="F")

    def _body(self) -> "_Body":
        return _Body(self._file, self._at, self._n_bytes, self._is_compressed)


@final
class _Body:
    """The content of one element, inflated where it is compressed, read from front to back."""

    def __init__(self, file: BinaryIO, at: int, n_bytes: int, is_compressed: bool) -> None:
        self._file, self._at, self._left = file, at, n_bytes
        self._inflater = zlib.decompressobj() if is_compressed else None

    def read(self, n_bytes: int) -> bytes:
        """Up to so many bytes; memory grows with what is there, not with what was asked for."""
        if self._inflater is None:
            return self._raw(n_bytes)
        out = bytearray()
        while len(out) < n_bytes:
            packed = self._inflater.unconsumed_tail or self._raw(_CHUNK_BYTES)
            fresh = self._inflater.decompress(packed, n_bytes - len(out))
            out += fresh
            if self._inflater.eof or not (packed or fresh):
                break
        return bytes(out)

    def _raw(self, n_bytes: int) -> bytes:
        self._file.seek(self._at)
        content = self._file.read(min(n_bytes, self._left))
        self._at += len(content)
        self._left -= len(content)
        return content


def _parsed(order: str, body: bytes) -> _Variable:
    """Flags, shape and name: three elements, each padded to 8 bytes."""
    _, flags, at = _element(order, body, 0)
    if len(flags) != 8:
        raise _DamagedError("a variable without flags")
    matlab_class, has_bits = (flags[0], flags[1]) if order == "<" else (flags[3], flags[2])
    if matlab_class > _NUMBER_CLASSES[-1]:
        return _Variable("", is_number=False, shape=(), data_at=0)
    kind, raw, at = _element(order, body, at)
    shape = struct.unpack(f"{order}{len(raw) // 4}i", raw)
    if kind != _INT32 or not 2 <= len(shape) <= _MAX_DIMENSIONS or min(shape) < 0:
        raise _DamagedError("a variable without a shape")
    _, name, at = _element(order, body, at)
    is_number = matlab_class in _NUMBER_CLASSES and not has_bits & _COMPLEX
    return _Variable(name.decode("ascii"), is_number, shape, at)


def _element(order: str, body: bytes, at: int) -> tuple[int, bytes, int]:
    """Type and content of a data element, and where the next one begins."""
    kind, n_bytes, inline = _tag(order, body[at : at + 8])
    if inline:
        return kind, inline, at + 8
    content = body[at + 8 : at + 8 + n_bytes]
    if len(content) != n_bytes:
        raise _DamagedError("a variable without a name")
    return kind, content, at + 8 + n_bytes + -n_bytes % 8


def _tag(order: str, tag: bytes) -> tuple[int, int, bytes]:
    """Type, length and, of a small element, the content: type and length share a word then, up to 4 bytes follow."""
    kind, n_bytes = _unpack(order, tag)
    if kind >> 16:
        if kind >> 16 > 4:
            raise _DamagedError(f"a small element of {kind >> 16} bytes")
        return kind & 0xFFFF, kind >> 16, tag[4 : 4 + (kind >> 16)]
    return kind, n_bytes, b""


def _unpack(order: str, tag: bytes) -> tuple[int, int]:
    kind, n_bytes = struct.unpack(f"{order}II", tag)
    return kind, n_bytes
