"""Arrays of numbers and of fixed-length text from ``.npz`` and ``.npy`` files, of any source.

NumPy's own reader takes the memory that a header asks for, inflates as much as an archive claims to hold, and knows
compressions (bzip2, LZMA) that make gigabytes of a kilobyte. Here an array is read after its shape was held against
what the archive holds, and all arrays together against the size of the file.
"""

import math
import zipfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from io import BufferedIOBase, BytesIO
from pathlib import Path
from typing import IO

import numpy as np
from numpy import ndarray
from numpy.lib import format as npy_format

from pix2face.errors import InputFileError
from pix2face.files.opening import check_regular, largest_unfolded, read_regular

_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_LARGEST_HEADER_BYTES = 1 << 16
_HEADERS = {(1, 0): npy_format.read_array_header_1_0, (2, 0): npy_format.read_array_header_2_0}


def npz_names(path: Path, largest_bytes: int) -> tuple[str, ...]:
    """Names of the arrays of a file.

    Raises:
        InputFileError: As `read_npz`.
    """
    with _opened(path, "an .npz file of arrays", largest_bytes) as archive:
        return tuple(info.filename.removesuffix(".npy") for info in archive.infolist())


def read_npz(path: Path, wanted: Collection[str], expected: str, largest_bytes: int) -> dict[str, ndarray]:
    """Reads arrays by their names; those that the file lacks are left out. Arguments are as for `check_regular`.

    Raises:
        InputFileError: The file is missing, damaged, hostile or of another format, or a wanted array holds neither
            numbers nor text.
    """
    with _opened(path, expected, largest_bytes) as archive:
        left, arrays = largest_unfolded(path.stat().st_size), dict[str, ndarray]()
        for info in archive.infolist():
            name = info.filename.removesuffix(".npy")
            if name in wanted and name not in arrays:
                arrays[name] = _read_member(archive, info, left)
                left -= arrays[name].nbytes
        return arrays


def read_npy(path: Path, expected: str, largest_bytes: int) -> ndarray:
    """Reads the array of an ``.npy`` file; arguments and errors as `read_npz`."""
    content = read_regular(path, expected, largest_bytes)
    try:
        return _read_array(BytesIO(content), "the file", len(content))
    except Exception as error:  # NumPy raises a dozen kinds on damaged headers
        raise _unreadable(path, expected, error) from error


@contextmanager
def _opened(path: Path, expected: str, largest_bytes: int) -> Iterator[zipfile.ZipFile]:
    check_regular(path, expected, largest_bytes)
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except InputFileError:
        raise
    except Exception as error:  # zipfile and zlib raise a dozen kinds on damaged archives
        raise _unreadable(path, expected, error) from error


def _unreadable(path: Path, expected: str, error: Exception) -> InputFileError:
    return InputFileError(
        f"{path}: expected {expected}, found one that cannot be read ({type(error).__name__}: {error})"
    )


def _read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, largest_bytes: int) -> ndarray:
    if info.compress_type not in _COMPRESSIONS:
        raise ValueError(f"{info.filename} is compressed by other means than deflate")
    with archive.open(info) as stream:
        return _read_array(stream, info.filename, min(info.file_size, largest_bytes))


def _read_array(stream: BufferedIOBase | IO[bytes], name: str, largest_bytes: int) -> ndarray:
    read_header = _HEADERS[npy_format.read_magic(stream)]
    shape, is_fortran, dtype = read_header(stream, max_header_size=_LARGEST_HEADER_BYTES)
    declared = math.prod(shape) * dtype.itemsize
    if dtype.kind not in "fiuSU" or declared > largest_bytes:
        raise ValueError(f"{name} declares {dtype} {shape}, at most {largest_bytes} bytes of numbers are possible")
    content = stream.read(declared)
    return np.frombuffer(content, dtype=dtype).reshape(shape, order="F" if is_fortran else "C")
