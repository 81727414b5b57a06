"""What grammars are made of: numbers, texts and shapes that programs stumble over, and JSON with some of them in it."""

import json
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")
Rng = np.random.Generator


class Raw:
    """A piece of JSON as it is to be written."""

    def __init__(self, text: str) -> None:
        self.text = text


# fmt: off
NUMBERS = (
    0, 1, -1, 2, 67, 68, 255, 2**31 - 1, 2**31, 2**32, 2**53 + 1, 2**63, -(2**63), 10**400, 0.5, -0.0, 1e-300, 1e308,
)
# fmt: on
LENGTHS = (0, 1, 2, 3, 67, 68, 69, 255, 65_536, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1)
# fmt: off
TEXTS = (
    "", " ", "x", "0", "nan", "inf", "-1e999", "../../etc/passwd", "/dev/zero", "a" * 300, "b" * 70_000, "\0",
    "\x1b[2J", "é", "\U0001f600", "%s%n", "{}", "<&>", "00", "é/x" * 200, "__class__",
)
JSON_PIECES: tuple[Any, ...] = (
    *NUMBERS, *TEXTS, None, True, [], {}, [[]], [1, "a"], {"a": {}}, Raw("NaN"), Raw("Infinity"), Raw("-Infinity"),
    Raw("1e999"), Raw("9" * 5000), Raw('"\\ud800"'), Raw("[" * 3000 + "]" * 3000),
    Raw('{"a":' * 900 + "1" + "}" * 900), Raw(""), Raw("{"), Raw("0x10"), Raw("[" + "0," * 20_000 + "0]"),
    Raw('"' + "z" * 10**6 + '"'),
)
# fmt: on


def one(rng: Rng, choices: Any) -> Any:
    """One of some values."""
    return choices[int(rng.integers(len(choices)))]


def mutated(value: Any, rng: Rng, pieces: Any = JSON_PIECES) -> Any:
    """A copy of JSON in which one part is another piece, is missing, or is there many times."""
    if isinstance(value, dict | list) and value and rng.random() < 0.85:
        copy = dict(value) if isinstance(value, dict) else list(value)
        key = one(rng, list(copy) if isinstance(copy, dict) else range(len(copy)))
        kind = rng.integers(8)
        if kind == 0:
            del copy[key]
        elif kind == 1 and isinstance(copy, list):
            copy *= int(one(rng, (2, 3, 100)))
        elif kind == 2 and isinstance(copy, dict):
            copy[one(rng, TEXTS)] = copy[key]
        else:
            copy[key] = mutated(copy[key], rng, pieces)
        return copy
    return one(rng, pieces)


def written(value: Any) -> str:
    """JSON with its raw pieces."""
    raw: list[str] = []

    def noted(piece: Any) -> Any:
        if isinstance(piece, Raw):
            raw.append(piece.text)
            return f"@raw{len(raw) - 1}@"
        if isinstance(piece, dict):
            return {str(key): noted(child) for key, child in piece.items()}
        return [noted(child) for child in piece] if isinstance(piece, list | tuple) else piece

    text = json.dumps(noted(value))
    for index, piece in enumerate(raw):
        text = text.replace(f'"@raw{index}@"', piece)
    return text


def several(rng: Rng, change: Callable[[T], T], value: T) -> T:
    """Changes a value once to three times."""
    for _ in range(int(rng.integers(1, 4))):
        value = change(value)
    return value
