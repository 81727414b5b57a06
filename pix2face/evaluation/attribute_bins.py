"""Errors of landmarks told apart by what renders were drawn from: skin tone, light, how much of the face is seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.evaluation.benchmark_data import BenchmarkItem
from pix2face.evaluation.bootstrap import Bootstrap, Interval, intervals, mean_of
from pix2face.evaluation.metrics import ErrorSummary, summarise
from pix2face.sample_filter import AttributeExpression

# Quarters: of 600 faces 150 each, whose means have intervals of about a tenth.
N_BINS = 4
NOT_THERE = "none"

Value = str | float | None


@final
@dataclass(frozen=True)
class AttributeValues:
    """What an expression says of each face.

    Attributes:
        attribute: The expression, as it was given.
        of_face: By the face's name; None for a face that lacks the attribute.
    """

    attribute: str
    of_face: Mapping[str, Value]


@final
@dataclass(frozen=True)
class AttributeBin:
    """A row of the table.

    Attributes:
        name: The value, or the range of values ("0.1 to 0.25"; the upper end belongs to the next bin), or "none".
        errors: Over all 68 points.
        interval: 95 % interval of their mean.
    """

    name: str
    errors: ErrorSummary
    interval: Interval | None


@final
@dataclass(frozen=True)
class ErrorsByAttribute:
    """Errors in bins of one attribute, numbers in ascending order."""

    attribute: str
    bins: tuple[AttributeBin, ...]


def attribute_values(expressions: Sequence[str], items: Sequence[BenchmarkItem]) -> tuple[AttributeValues, ...]:
    """Evaluates expressions of attributes for the faces of a benchmark.

    Raises:
        UsageError: An expression is none, or takes an attribute that no face has.
    """
    return tuple(_values(text, items) for text in expressions)


def errors_by_attribute(
    values: AttributeValues, errors: Mapping[str, float], threshold: float, bootstrap: Bootstrap
) -> ErrorsByAttribute:
    """Divides faces by the values of an attribute.

    Args:
        values: Of each face.
        errors: The error of each face that was evaluated, a fraction, by its name; infinity where it was not found.
        threshold: Where a face counts as failed.
        bootstrap: How intervals are drawn: over the faces of a bin.
    """
    names, of_face = list(errors), np.array(list(errors.values()), dtype=np.float64)
    own_values = [values.of_face[name] for name in names]
    rows: dict[str, list[int]] = {}
    for index, name in sorted(enumerate(bin_names(own_values)), key=lambda face: _place(own_values[face[0]])):
        rows.setdefault(name, []).append(index)
    return ErrorsByAttribute(
        values.attribute,
        tuple(
            AttributeBin(
                name,
                summarise(of_face[chosen], threshold),
                intervals({"mean": mean_of(of_face[chosen])}, np.arange(len(chosen)), bootstrap)["mean"],
            )
            for name, chosen in rows.items()
        ),
    )


def bin_names(values: Sequence[Value]) -> list[str]:
    """The name of the bin that each value lies in: numbers divided at their quartiles, anything else by itself.

    Equal numbers lie in one bin, so that an attribute of few values has fewer bins than quarters.
    """
    numbers = [number for number in map(_number, values) if number is not None]
    edges = np.unique(np.quantile(numbers, np.linspace(0, 1, N_BINS + 1))) if numbers else np.empty(0)
    return [_bin_name(value, edges) for value in values]


def _values(text: str, items: Sequence[BenchmarkItem]) -> AttributeValues:
    expression = AttributeExpression(text, "--by")
    of_face = {item.name: expression.value(item.name, item.attributes) for item in items}
    if items:  # of no face nothing can be said, which is another error's task
        expression.check_names()
    return AttributeValues(expression.text, of_face)


def _number(value: Value) -> float | None:
    """The value where it is a number; ``yaw_deg > 0`` is none, it has two values with names."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _bin_name(value: Value, edges: Float64[ndarray, " n"]) -> str:
    number = _number(value)
    if number is None:
        return NOT_THERE if value is None else str(value)
    low = int(np.searchsorted(edges, number, side="right").clip(1, max(len(edges) - 1, 1))) - 1
    high = min(low + 1, len(edges) - 1)
    return f"{edges[low]:.3g}" + (f" to {edges[high]:.3g}" if high > low else "")


def _place(value: Value) -> tuple[int, float, str]:
    """Where a value stands in the table: numbers by size, then texts by the alphabet, what is not there last."""
    number = _number(value)
    if number is not None:
        return 0, number, ""
    return (2, 0.0, "") if value is None else (1, 0.0, str(value))
