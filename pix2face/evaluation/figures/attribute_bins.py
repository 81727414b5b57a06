"""Errors of landmarks by attributes of the renders: skin tone, light, how much of the face is seen."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from pix2face.errors import UsageError
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkItem
from pix2face.evaluation.figures.bootstrap import Bootstrap, Interval, intervals, mean_of
from pix2face.geometry.landmark_metrics import ErrorSummary, summarise
from pix2face.shards.sample_filter import AttributeExpression

# Quarters: of 600 faces 150 each, whose means have intervals of about a tenth.
N_QUARTERS = 4
# More rows than a reader looks at: most likely a name that tells each face from all others.
MOST_TEXTS = 50
NOT_THERE = "not there"

Value = str | float | None
# The order of rows: numbers, conditions, texts and missing values; numbers by quarter; the others by text.
_Key = tuple[int, int, str]


@final
@dataclass(frozen=True)
class AttributeValues:
    """The value of an expression for each face."""

    attribute: str  # the expression, as it was given
    of_face: Mapping[str, Value]  # by the name of the face; None for a face that lacks the attribute


@final
@dataclass(frozen=True)
class AttributeBin:
    """A row of the table."""

    name: str  # the value, or the smallest and the largest one ("0.1 to 0.25"), or "not there"
    errors: ErrorSummary  # over all 68 points
    interval: Interval | None  # 95 % interval of their mean


@final
@dataclass(frozen=True)
class ErrorsByAttribute:
    """Errors in bins of one attribute: numbers in ascending order, then conditions, texts, and missing values."""

    attribute: str
    bins: tuple[AttributeBin, ...]


def attribute_values(expressions: Sequence[str], items: Sequence[BenchmarkItem]) -> tuple[AttributeValues, ...]:
    """Evaluates expressions of attributes for the faces of a benchmark.

    Raises:
        UsageError: An expression is none, takes an attribute that no face has, or says something that faces cannot be
            divided by: a list, a number that is not finite, more than 50 texts.
    """
    return tuple(_values(text, items) for text in expressions)


def errors_by_attribute(
    values: AttributeValues, errors: Mapping[str, float], threshold: float, bootstrap: Bootstrap
) -> ErrorsByAttribute:
    """Errors of the faces in each bin of an attribute, with intervals over the faces of the bin.

    Errors are fractions by the name of the face; infinity where it was not found.
    """
    of_face = np.array(list(errors.values()), dtype=np.float64)
    bins = []
    for name, chosen in divided([values.of_face[name] for name in errors]):
        interval = intervals({"mean": mean_of(of_face[chosen])}, np.arange(len(chosen)), bootstrap)["mean"]
        bins.append(AttributeBin(name, summarise(of_face[chosen], threshold), interval))
    return ErrorsByAttribute(values.attribute, tuple(bins))


def divided(values: Sequence[Value]) -> list[tuple[str, list[int]]]:
    """Names of bins, and which values lie in each: numbers by quarters, anything else by itself.

    Equal numbers lie in one bin: in the quarter that the middle one of them has by its rank. So a number that most
    faces share has a bin of its own, and the bins are quarters where hardly any two are equal.
    """
    numbers = np.sort([number for number in map(_number, values) if number is not None])
    rows: dict[_Key, list[int]] = {}
    for index, value in enumerate(values):
        rows.setdefault(_key(value, numbers), []).append(index)
    ordered = [rows[key] for key in sorted(rows)]
    return list(zip(_names([[values[index] for index in row] for row in ordered]), ordered, strict=True))


def _values(text: str, items: Sequence[BenchmarkItem]) -> AttributeValues:
    expression = AttributeExpression(text, "--by")
    of_face = {item.name: _checked(text, expression.value(item.name, item.attributes)) for item in items}
    if items:  # without faces, a later error says that there are none
        expression.check_names()
    n_texts = len({value for value in of_face.values() if isinstance(value, str)})
    if n_texts > MOST_TEXTS:
        raise UsageError(f"--by {text!r}: expected at most {MOST_TEXTS} different texts, found {n_texts}")
    return AttributeValues(expression.text, of_face)


def _checked(text: str, value: Any) -> Value:
    try:
        if value is None or isinstance(value, str) or (isinstance(value, int | float) and math.isfinite(value)):
            return value
    except OverflowError:  # an integer beyond all floats
        pass
    raise UsageError(f"--by {text!r}: expected a finite number, a text or a condition, found {str(value)[:40]}")


def _number(value: Value) -> float | None:
    """The value where it is a number; ``yaw_deg > 0`` is none: it holds or not."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _key(value: Value, numbers: np.ndarray) -> _Key:
    number = _number(value)
    if number is not None:
        rank = (np.searchsorted(numbers, number, "left") + np.searchsorted(numbers, number, "right")) / 2
        return 0, min(int(N_QUARTERS * rank / len(numbers)), N_QUARTERS - 1), ""
    if value is None:
        return 3, 0, ""
    return (1 if isinstance(value, bool) else 2), 0, str(value)


def _names(bins: Sequence[Sequence[Value]]) -> list[str]:
    """Numbers with as many digits as tell their bins apart; texts that read like another bin's name in quotes."""
    of_numbers = [values for values in bins if _number(values[0]) is not None]
    digits = next((n for n in range(3, 17) if len({_name(own, n) for own in of_numbers}) == len(of_numbers)), 17)
    names = [_name(values, digits) for values in bins]
    return [
        repr(name) if isinstance(values[0], str) and names.count(name) > 1 else name
        for name, values in zip(names, bins, strict=True)
    ]


def _name(values: Sequence[Value], digits: int) -> str:
    numbers = [number for number in map(_number, values) if number is not None]
    if not numbers:
        return NOT_THERE if values[0] is None else str(values[0])
    low, high = min(numbers), max(numbers)
    return f"{low:.{digits}g}" + (f" to {high:.{digits}g}" if high > low else "")
