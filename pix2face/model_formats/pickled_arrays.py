"""Arrays of numbers from what `restricted_pickle` read: records whose sizes are checked before an array is made."""

import math
from typing import Any, Final

import numpy as np
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.model_formats.restricted_pickle import (
    LARGEST_ARRAY_BYTES,
    LONGEST_NAME,
    Budget,
    Record,
    checked_text,
    latin1_bytes,
)

_ELEMENT_BYTES, _MOST_LEVELS, _MOST_DIMENSIONS = 512, 8, 32
_NUMBER_KINDS: Final = "fiub"


def as_array(value: Any, where: str) -> ndarray:
    """Makes an array of numbers from a record that ``read_pickle`` returned; ``where`` (file and key) is for messages.

    Raises:
        InputFileError: The record is not an array of numbers, or its size does not fit its data.
    """
    try:
        return _as_array(value, Budget(LARGEST_ARRAY_BYTES, "bytes"), depth=0)
    except Exception as error:
        raise InputFileError(f"{where}: expected an array of numbers, found none ({error})") from error


def _as_array(value: Any, budget: Budget, depth: int) -> ndarray:
    if depth > _MOST_LEVELS:
        raise ValueError("containers within containers")
    if not isinstance(value, Record):
        array = np.asarray(_numbers(value, budget, depth))
        if array.dtype.kind not in _NUMBER_KINDS:
            raise ValueError(f"{type(value).__name__}")
        return array
    if value.kind == "array":
        return _from_array_state(value.state, budget)
    if value.kind == "frombuffer" and value.arguments:  # protocol 5
        data, dtype, shape, order = value.arguments
        return _from_array_state((1, shape, dtype, order == "F", data), budget)
    if value.kind == "scalar" and value.arguments:
        data = latin1_bytes(value.arguments[1], budget)
        return np.frombuffer(data, dtype=_as_dtype(value.arguments[0]), count=1).reshape(())
    if value.kind == "chumpy" and isinstance(value.state, dict):
        return _from_chumpy(value, budget, depth)
    raise ValueError(value.name[:LONGEST_NAME])


def _numbers(value: Any, budget: Budget, depth: int) -> Any:
    """A number, or lists of numbers, each counted as often as it is referred to."""
    if isinstance(value, int | float):
        return value
    if not isinstance(value, list | tuple) or depth > _MOST_LEVELS:
        raise ValueError(f"{type(value).__name__}")
    budget.spend(_ELEMENT_BYTES * (1 + len(value)))
    return [_numbers(child, budget, depth + 1) for child in value]


def _from_chumpy(value: Record, budget: Budget, depth: int) -> ndarray:
    if value.name == "chumpy.ch.Ch":
        return _as_array(value.state["x"], budget, depth + 1)
    if value.name == "chumpy.reordering.Select":
        source, places = (_as_array(value.state[key], budget, depth + 1) for key in ("a", "idxs"))
        budget.spend(places.size * source.itemsize + source.nbytes)
        chosen = source.ravel()[places]
        shape = value.state.get("preferred_shape")
        return chosen if shape is None else chosen.reshape(_shape(_as_array(shape, budget, depth + 1).tolist()))
    raise ValueError(f"the unevaluated expression {value.name[:LONGEST_NAME]}")


def _from_array_state(state: Any, budget: Budget) -> ndarray:
    """NumPy's own state of an array: version, shape, dtype, column order, data."""
    _, lengths, dtype_record, is_fortran, data = state
    shape, dtype, content = _shape(lengths), _as_dtype(dtype_record), latin1_bytes(data, budget)
    if math.prod(shape) * dtype.itemsize != len(content):
        raise ValueError(f"shape {shape} with {len(content)} bytes of data")
    return np.frombuffer(content, dtype=dtype).reshape(shape, order="F" if is_fortran else "C")


def _shape(lengths: Any) -> tuple[int, ...]:
    if not isinstance(lengths, list | tuple) or len(lengths) > _MOST_DIMENSIONS:
        raise TypeError(f"a shape of type {type(lengths).__name__}")
    if not all(isinstance(length, int) and 0 <= length < 1 << 48 for length in lengths):
        raise ValueError("a shape of other things than lengths")
    return tuple(lengths)


def _as_dtype(record: Any) -> np.dtype[Any]:
    if not isinstance(record, Record) or record.kind != "dtype" or not record.arguments:
        raise ValueError("an array without a type")
    order = record.state[1] if record.state else "="
    dtype = np.dtype(checked_text(record.arguments[0])[:LONGEST_NAME])
    if dtype.kind not in _NUMBER_KINDS or not isinstance(order, str) or order not in "<>|=":
        raise ValueError(f"an array of {dtype}")
    return np.dtype(f"{order}{dtype.kind}{dtype.itemsize}") if order in "<>" else dtype
