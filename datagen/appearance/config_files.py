"""Configurations as TOML: read with every mistake named, written with every number explained."""

import inspect
import re
import textwrap
import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from pix2face.errors import InputFileError

T = TypeVar("T")

_ATTRIBUTE = re.compile(r"^ {8}(\w+): (.*(?:\n {12}.*)*)", re.MULTILINE)


def read_toml(path: Path) -> dict[str, Any]:
    """Reads a file.

    Raises:
        InputFileError: It is missing, or no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputFileError(f"{path}: expected a TOML file, found one that cannot be read ({error})") from error


def replaced(base: T, given: Mapping[str, Any], where: str, table: str = "") -> T:
    """A configuration with some of its fields replaced, tables by tables.

    Args:
        base: A frozen dataclass of numbers, texts, tuples and such dataclasses.
        given: By name, as TOML has them.
        where: For messages: the file.
        table: For messages: the name of the table with a dot behind it, none at the top.

    Raises:
        InputFileError: A name is unknown, or a value is of another kind than the one that it replaces.
    """
    known = {field.name: getattr(base, field.name) for field in fields(base)}  # type: ignore[arg-type]
    unknown = sorted(given.keys() - known.keys())
    if unknown:
        raise InputFileError(f"{where}: {table}{unknown[0]}: expected one of {', '.join(known)}, found {unknown[0]!r}")
    changed = {name: _value(known[name], value, where, table + name) for name, value in given.items()}
    return replace(base, **changed)  # type: ignore[type-var]


def to_toml(configuration: Any, table: str = "") -> str:
    """Writes a configuration as TOML, with what its docstring says of each field above it."""
    described = _descriptions(type(configuration))
    lines, tables = [f"[{table}]"] if table else [], []
    for field in fields(configuration):
        value = getattr(configuration, field.name)
        if is_dataclass(value):
            tables.append(to_toml(value, f"{table}.{field.name}".lstrip(".")))
            continue
        if field.name in described:
            lines += textwrap.wrap(described[field.name], 100, initial_indent="# ", subsequent_indent="# ")
        lines.append(f"{field.name} = {_toml_value(value)}")
    return "\n".join(["\n".join(lines) + "\n", *tables])


def _value(old: Any, new: Any, where: str, option: str) -> Any:
    if is_dataclass(old):
        if not isinstance(new, dict):
            raise InputFileError(f"{where}: {option}: expected a table, found {new!r}")
        return replaced(old, new, where, f"{option}.")
    if isinstance(old, tuple) and isinstance(new, list):
        if old and len(old) != len(new):
            raise InputFileError(f"{where}: {option}: expected {len(old)} values, found {new}")
        return tuple(_value(*pair, where, option) for pair in zip(old, new, strict=True)) if old else tuple(new)
    if isinstance(old, float) and isinstance(new, int) and not isinstance(new, bool):
        return float(new)
    if type(old) is not type(new):
        raise InputFileError(f"{where}: {option}: expected {_kind(old)} such as {old!r}, found {new!r}")
    return new


def _kind(value: Any) -> str:
    return {bool: "true or false", int: "a whole number", float: "a number", str: "a text", tuple: "a list"}.get(
        type(value), type(value).__name__
    )


def _toml_value(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml_value, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(value)


def _descriptions(kind: type) -> dict[str, str]:
    text = inspect.getdoc(kind) or ""
    section = text.partition("Attributes:")[2]
    indented = re.sub(r"^", "    ", section, flags=re.MULTILINE)
    return {name: " ".join(words.split()) for name, words in _ATTRIBUTE.findall(indented)}
