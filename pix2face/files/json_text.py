"""JSON from files: parsed, and refused where it is not of the type that it should have.

JSON of other programs, and of damaged files, may hold NaN, infinity, numbers of a thousand digits, lists a thousand
deep, or a list where an object belongs. None of this passes. Python's parser is used rather than msgspec's own, since
names of files that are not UTF-8 stand in JSON as lone surrogates, which only the former reads.
"""

import json
import math
from codecs import BOM_UTF8
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

from pix2face.errors import InputFileError
from pix2face.files.opening import read_regular

T = TypeVar("T")

# A value takes up to 100 bytes of memory. The report of the largest benchmark has three million.
MOST_VALUES = 8_000_000
MOST_LEVELS = 32
# Whole numbers that 64-bit floats, and JavaScript, hold exactly.
_LARGEST_INTEGER = 2**53
Integer = Annotated[int, msgspec.Meta(ge=-_LARGEST_INTEGER, le=_LARGEST_INTEGER)]
Count = Annotated[int, msgspec.Meta(ge=1, le=_LARGEST_INTEGER)]
Positive = Annotated[float, msgspec.Meta(gt=0, le=1e12)]
JsonObject = dict[str, Any]


def parse_json(
    text: str | bytes, kind: type[T] | Any, most_values: int = MOST_VALUES, *, must_be_finite: bool = True
) -> Any:
    """Parses JSON.

    Args:
        text: The JSON, in UTF-8 where it comes as bytes.
        kind: The type of what is returned: a dataclass, or a type made of lists, dictionaries, texts and numbers. Texts
            and numbers are not turned into each other; unknown fields of a dataclass are left out.
        most_values: A text of more values is not parsed.
        must_be_finite: Whether NaN and infinity are refused.

    Raises:
        ValueError: The text is no JSON, is of another type, or holds a number that is not finite.
    """
    content = text.decode("utf-8") if isinstance(text, bytes) else text
    n_values = sum(map(content.count, ",[{"))
    if n_values > most_values:
        raise ValueError(f"{n_values} values, where at most {most_values} are read")
    try:
        value = (_FINITE if must_be_finite else _ANY_NUMBER).decode(content)
    except RecursionError as error:
        raise ValueError(f"more than {MOST_LEVELS} levels") from error
    if kind is JsonObject:  # other types say themselves how deep they are
        _check_levels(value)
    return typed(value, kind)


def typed(value: Any, kind: type[T] | Any) -> Any:
    """What `json` parsed, as another type; as `parse_json`."""
    try:
        return msgspec.convert(value, kind, dec_hook=_path)
    except msgspec.ValidationError as error:
        raise ValueError(f"{error}") from error


def read_json_file(path: Path, kind: type[T] | Any, expected: str, largest_bytes: int) -> Any:
    """Reads a JSON file; ``kind`` is as for `parse_json`, the other arguments as for `opening.check_regular`.

    Raises:
        InputFileError: It is missing, no regular file, too large, no JSON, or of another type.
    """
    try:
        return parse_json(read_regular(path, expected, largest_bytes).removeprefix(BOM_UTF8), kind)
    except ValueError as error:
        raise InputFileError(f"{path}: expected {expected}, found something else ({error})") from error


def _path(kind: type, value: Any) -> Path:
    """A path from its text; msgspec knows of no other type of ours."""
    if kind is Path and isinstance(value, str):
        return Path(value)
    raise TypeError(f"Expected `str`, got `{type(value).__name__}`")


def _check_levels(value: Any) -> None:
    """What is deeper could be parsed, but not be written or compared."""
    level = [value]
    for _ in range(MOST_LEVELS):
        containers = (
            item.values() if isinstance(item, dict) else item for item in level if isinstance(item, dict | list)
        )
        level = [child for container in containers for child in container]
        if not level:
            return
    raise ValueError(f"more than {MOST_LEVELS} levels")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"the number {text[:20]} is not finite")
    return number


_FINITE, _ANY_NUMBER = json.JSONDecoder(parse_float=_finite, parse_constant=_finite), json.JSONDecoder()
