"""Reads HDF5 files from untrusted sources: no links out of the file, no declared size that the file cannot hold.

HDF5 can point at other files (external links, external storage, virtual datasets) and can declare arrays far larger
than what it stores. A model file needs neither.
"""

from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
from numpy import ndarray

from pix2face.errors import InputFileError

# Deflate, the only filter in use that shrinks much, never shrinks more than this.
LARGEST_COMPRESSION = 1032
# An array that was never written takes no space in the file and reads as its fill value: fine as long as it is small.
UNWRITTEN_BYTES = 1 << 16
# No published model comes near: the bases of BFM at full size take 0.25 GB in double precision.
LARGEST_ARRAY_BYTES = 4 << 30
# What the library raises on damaged files, wherever it comes upon the damage.
_LIBRARY_ERRORS = (OSError, KeyError, RuntimeError, ValueError, SystemError)


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """Opens a file for reading, after checking that it holds all of its data.

    Raises:
        InputFileError: No HDF5, damaged, or with links, external storage, virtual data or sizes beyond the file's.
    """
    try:
        with h5py.File(path, "r") as file:
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
    while pending:
        group, prefix = pending.pop()
        address = h5py.h5o.get_info(group.id).addr
        if address in seen:
            continue  # hard links may form a loop
        seen.add(address)
        for name in group:
            found = f"{prefix}/{name}"
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise InputFileError(f"{path}: expected all data in the file, found that {found} links elsewhere")
            item = group[name]
            if isinstance(item, h5py.Group):
                pending.append((item, found))
            elif isinstance(item, h5py.Dataset):
                _check_dataset(item, found, path, found in sliced)


def read_array(file: h5py.File, name: str, path: Path) -> ndarray:
    """Reads a dataset of numbers as it is stored.

    Raises:
        InputFileError: The dataset is missing, or does not hold numbers.
    """
    item = file.get(name)
    if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu":
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
            kind, value = item.get_id(name).dtype.kind, None
            value = item[name] if kind == "S" else None
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


def _check_dataset(item: h5py.Dataset, name: str, path: Path, is_sliced: bool) -> None:
    properties = item.id.get_create_plist()
    if properties.get_external_count() or item.is_virtual:
        raise InputFileError(f"{path}: expected all data in the file, found that {name} is stored outside of it")
    declared = int(np.prod(item.shape or (), dtype=object)) * item.dtype.itemsize
    stored = item.id.get_storage_size()
    holds = LARGEST_COMPRESSION * stored if item.chunks else stored
    largest = min(max(holds, UNWRITTEN_BYTES), LARGEST_ARRAY_BYTES)
    if (declared > largest and not is_sliced) or stored > path.stat().st_size:
        raise InputFileError(
            f"{path}: expected {name} to hold what it declares, found {declared} bytes declared and {stored} stored "
            f"(limit {LARGEST_ARRAY_BYTES}); the file is damaged or hostile"
        )
