"""Columns of text in HDF5 files: one dataset of UTF-8 bytes, usually with one JSON value in each line.

HDF5's own text of variable length keeps lengths apart from texts, and a damaged length makes the library read memory
that is not the file's. Text of fixed length needs the longest before the first is written. Lines need neither, and any
language reads them.
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.json_text import Integer, parse_json

# The attributes of a sample. NaN and infinity are no JSON, but what `write_shard` was given.
ATTRIBUTES = dict[str, str | bool | Integer | float]
# A column may be compressed, but not to unfold to more than this beyond the size of its file: values take some twenty
# times the memory of their text.
LARGEST_TEXT_BYTES = 16 << 20


def json_lines(values: Iterable[object]) -> UInt8[ndarray, " n"]:
    """Encodes values as a column."""
    text = "".join(f"{json.dumps(value, sort_keys=True)}\n" for value in values)
    return np.frombuffer(text.encode("ascii"), dtype=np.uint8)


def read_json_lines(file: h5py.File, name: str, path: Path, kind: Any = Any, n: int | None = None) -> list[Any]:
    """Reads the values of a column, each of a kind (`json_text.parse_json`), and n of them where that is known.

    Raises:
        InputFileError: The column is missing, or holds something else.
    """
    item = file.get(name)
    if not isinstance(item, h5py.Dataset) or item.dtype != np.uint8 or item.ndim != 1:
        raise InputFileError(f"{path}: expected lines of text as {name}, found {'nothing' if item is None else item}")
    if item.size > LARGEST_TEXT_BYTES + path.stat().st_size:
        raise InputFileError(f"{path}: expected lines of text as {name}, found that they unfold to {item.size} bytes")
    content = item[()].tobytes()
    n_lines = content.count(b"\n")
    if n is not None and n_lines != n:
        raise InputFileError(f"{path}: expected {n} rows of {name}, found {n_lines}")
    try:
        values: list[Any] = parse_json(
            b"[" + content[:-1].replace(b"\n", b",") + b"]", list[kind], len(content) + 1, must_be_finite=False
        )
    except ValueError as error:
        raise InputFileError(f"{path}: expected JSON in each line of {name}, found other text ({error})") from error
    if (not content.endswith(b"\n") and content) or len(values) != n_lines:
        raise InputFileError(f"{path}: expected one value in each line of {name}, found {len(values)} in {n_lines}")
    return values


def read_attributes(text: str | bytes) -> dict[str, str | float]:
    """Parses the attributes of a sample.

    Raises:
        ValueError: The text is not a JSON object of texts and numbers.
    """
    return parse_json(text, ATTRIBUTES, must_be_finite=False)


def bounded_utf8(text: str, name: str, largest: int) -> bytes:
    """Encodes text for a column of fixed length, where the longest text sets the length of all.

    Raises:
        InputFileError: The text is longer than `largest` bytes, or cannot be stored in such a column.
    """
    try:
        content, found = text.encode("utf-8"), "a NUL character" if "\0" in text else ""
    except UnicodeEncodeError:
        content, found = b"", "characters that UTF-8 has not"
    if len(content) > largest:
        found = f"{len(content)} bytes"
    if found:
        raise InputFileError(f"{text[:40]!r}: expected at most {largest} bytes of UTF-8 as {name}, found {found}")
    return content
