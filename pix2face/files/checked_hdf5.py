"""Reads HDF5 files from untrusted sources: no links out of the file, no declared size that the file cannot hold.

HDF5 can point at other files (external links, external storage, virtual datasets) and can declare arrays far larger
than what it stores. A model file needs neither.
"""

import math
from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
from isal import isal_zlib
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.opening import check_regular, largest_unfolded

# A set of renders may be as large as its owner likes; what is read of it at a time is bounded elsewhere.
LARGEST_FILE_BYTES = 1 << 45
# An array that was never written takes no space in the file and reads as its fill value: fine as long as it is small.
UNWRITTEN_BYTES = 1 << 16
LARGEST_ATTRIBUTE_BYTES = 1 << 24
MOST_GROUPS = 10_000
# The library takes this for each chunk of an array that it reads. Chunks of a few numbers would need far more memory
# than the array.
BYTES_FOR_CHUNK = 1 << 12
# What the library raises on damaged files, wherever it comes upon the damage.
# AttributeError: of a group where an array should be.
_LIBRARY_ERRORS = (OSError, KeyError, RuntimeError, ValueError, SystemError, AttributeError)


@contextmanager
def open_unchecked(path: Path, expected: str = "an HDF5 file") -> Iterator[h5py.File]:
    """Opens a file for reading; `check_contained` must follow before any of its data is read.

    Nothing is locked, as HDF5 would by default: finished files do not change, and some file systems have no locks.

    Raises:
        InputFileError: It is missing, or no regular file.
        OSError: It is no HDF5 file, or damaged.
    """
    check_regular(path, expected, LARGEST_FILE_BYTES)
    with h5py.File(path, "r", locking=False) as file:
        yield file


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """Opens a file for reading, after checking that it holds all of its data.

    Raises:
        InputFileError: No HDF5, damaged, or with links, external storage, virtual data or sizes beyond the file's.
    """
    try:
        with open_unchecked(path) as file:
            check_contained(file, path)
            yield file
    except _LIBRARY_ERRORS as error:
        raise InputFileError(
            f"{path}: expected an HDF5 file, found one that cannot be read ({type(error).__name__}: {error})"
        ) from error


def check_contained(file: h5py.File, path: Path, sliced: Container[str] = ()) -> None:
    """Walks all groups and checks links and datasets.

    The datasets in ``sliced`` (``/name``) may be of any size, since their reader takes and checks a part at a time.

    Raises:
        InputFileError: Something points out of the file, or declares more than the file can hold.
    """
    pending, seen = [(file, "")], set[int]()
    left = largest_unfolded(path.stat().st_size)
    while pending:
        group, prefix = pending.pop()
        address = h5py.h5o.get_info(group.id).addr
        if address in seen:
            continue  # hard links may form a loop
        seen.add(address)
        if len(seen) > MOST_GROUPS or len(group) > MOST_GROUPS:
            raise InputFileError(f"{path}: expected a file of some dozen arrays, found more than {MOST_GROUPS} groups")
        for name in group:
            found = f"{prefix}/{name}"
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise InputFileError(f"{path}: expected all data in the file, found that {found} links elsewhere")
            item = group[name]
            if isinstance(item, h5py.Group):
                pending.append((item, found))
            elif isinstance(item, h5py.Dataset):
                declared = _declared_bytes(item, found, path)
                left -= 0 if found in sliced else declared + _bytes_for_chunks(item)
                if left < 0:
                    raise _too_large(path, found, declared, item.id.get_storage_size())
                if found not in sliced:
                    _check_chunks(item, found, path)


def read_array(file: h5py.File, name: str, path: Path) -> ndarray:
    """Reads a dataset of numbers as it is stored.

    Raises:
        InputFileError: The dataset is missing, or does not hold numbers.
    """
    item = file.get(name)
    if not isinstance(item, h5py.Dataset) or item.shape is None or item.dtype.kind not in "fiu":
        raise InputFileError(f"{path}: expected numbers at {name}, found {'nothing' if item is None else item}")
    return np.asarray(item[()])


def read_text(item: h5py.AttributeManager | h5py.Dataset, path: Path, name: str = "") -> str:
    """Reads text of fixed length: an attribute by its name, or the only text of a dataset.

    Text of variable length is refused: its length is stored apart from it, and a damaged length makes the library read
    memory outside the file.

    Raises:
        InputFileError: No such text, or text of variable length.
    """
    try:
        if isinstance(item, h5py.AttributeManager):
            attribute = item.get_id(name)
            kind = attribute.dtype.kind
            is_readable = kind == "S" and attribute.get_storage_size() <= LARGEST_ATTRIBUTE_BYTES
            value = item[name] if is_readable else None
        else:
            name, kind = item.name, item.dtype.kind
            value = np.asarray(item[()]).ravel()[0] if kind == "S" and item.size else None
        if value is not None:
            return bytes(value).decode("utf-8")
    except (*_LIBRARY_ERRORS, TypeError) as error:
        raise InputFileError(f"{path}: expected text at {name}, found none ({error})") from error
    raise InputFileError(f"{path}: expected text of fixed length at {name}, found type {kind!r}")


def fixed_text(text: str) -> ndarray:
    """Text as files hold it (see `read_text`). HDF5 has no text of length 0, so an empty text takes one byte."""
    content = text.encode("utf-8")
    return np.array(content, dtype=f"S{max(1, len(content))}")


def read_version(attributes: h5py.AttributeManager, path: Path, name: str = "schema_version") -> int:
    """The ``schema_version`` of a file, or another attribute that is a whole number.

    Raises:
        InputFileError: There is none, or it is something else.
    """
    item = attributes.get_id(name) if name in attributes else None
    if item is None or item.shape != () or item.dtype.kind not in "iu":
        found = "none" if item is None else f"{item.dtype} of shape {item.shape}"
        raise InputFileError(f"{path}: expected a whole number as {name}, found {found}")
    return int(attributes[name])


def filters_of(dataset: h5py.Dataset) -> list[int]:
    """Numbers of the HDF5 filters that compress a dataset."""
    properties = dataset.id.get_create_plist()
    return [properties.get_filter(number)[0] for number in range(properties.get_nfilters())]


def _declared_bytes(item: h5py.Dataset, name: str, path: Path) -> int:
    """The memory that a dataset takes, or the largest piece of it that the library unfolds at once."""
    properties = item.id.get_create_plist()
    if properties.get_external_count() or item.is_virtual:
        raise InputFileError(f"{path}: expected all data in the file, found that {name} is stored outside of it")
    declared = max(math.prod(item.shape or ()), math.prod(item.chunks or ())) * item.dtype.itemsize
    stored = item.id.get_storage_size()
    if stored > path.stat().st_size or (not item.chunks and declared > max(stored, UNWRITTEN_BYTES)):
        raise _too_large(path, name, declared, stored)
    return declared


def _bytes_for_chunks(item: h5py.Dataset) -> int:
    """The memory that the library takes for chunks beside their content."""
    if not item.chunks:
        return 0
    return BYTES_FOR_CHUNK * math.prod(-(-n // chunk) for n, chunk in zip(item.shape, item.chunks, strict=True))


def _check_chunks(item: h5py.Dataset, name: str, path: Path) -> None:
    """Checks that each chunk unfolds to its declared size: the library reads as much, also beyond the end of less."""
    if not item.chunks:
        return
    n_bytes = math.prod(item.chunks) * item.dtype.itemsize
    filters = filters_of(item)
    if set(filters) - {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}:
        return  # of other compressions only the library knows the size
    for number in range(item.id.get_num_chunks()):
        left_out, content = item.id.read_direct_chunk(item.id.get_chunk_info(number).chunk_offset)
        if h5py.h5z.FILTER_DEFLATE in filters and not left_out >> filters.index(h5py.h5z.FILTER_DEFLATE) & 1:
            try:
                content = isal_zlib.decompressobj().decompress(content, n_bytes)
            except isal_zlib.error as error:  # type: ignore[misc] # the stub says it is a value
                raise OSError(f"a chunk of {name} cannot be unfolded ({error})") from error
        if len(content) < n_bytes:
            raise _too_large(path, f"a chunk of {name}", n_bytes, len(content))


def _too_large(path: Path, name: str, declared: int, stored: int) -> InputFileError:
    return InputFileError(
        f"{path}: expected {name} to hold what it declares, found {declared} bytes declared and {stored} stored; "
        "the file is damaged or hostile"
    )
