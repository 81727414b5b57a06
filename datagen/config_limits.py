"""Limits of the numbers in a configuration, and one form of message for those beyond them.

A field states its limits in its type: `roll_deg: FromZero = 12.0`. Messages name the option as users write it in TOML,
what was expected and what was found: `geometry.roll_deg: expected a number from 0, found -1.0`.
"""

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import pairwise
from typing import Annotated, Any, final, get_args, get_origin, get_type_hints

from pix2face.errors import UsageError


@final
@dataclass(frozen=True)
class Limits:
    """What the numbers of a field may be: finite, within limits and, if there are several, ascending."""

    least: float
    most: float = math.inf
    is_open: bool = False  # `least` itself is too small
    is_whole: bool = False  # the numbers are parts of a whole: they need not ascend, but sum to 1

    def hold(self, *numbers: float) -> bool:
        """Whether all numbers are within these limits."""
        if not all(math.isfinite(number) and self.least <= number <= self.most for number in numbers):
            return False
        if self.is_open and self.least in numbers:
            return False
        if self.is_whole:
            return math.isclose(sum(numbers), 1, abs_tol=1e-6)
        return all(a <= b for a, b in pairwise(numbers))

    def described(self, length: int) -> str:
        """What is expected of a list of this length, or of a single number (0)."""
        start = f"{'above' if self.is_open else 'from'} {self.least:g}"
        end = f" to {self.most:g}" if math.isfinite(self.most) else ""
        if not length:
            return f"a number {start}{end}"
        if self.is_whole:
            return f"{length} numbers {start}{end} that sum to 1"
        return f"{length} ascending numbers {start}{end}"


Range = tuple[float, float]
Share = Annotated[float, Limits(0, 1)]
FromZero = Annotated[float, Limits(0)]


@lru_cache(maxsize=64)  # each sample checks the same few tables
def check_limits(table: str, config: Any) -> None:
    """Raises a `UsageError` for the first field beyond the limits in its type, or with a wrong count of numbers in it.

    Fields of the dataclass whose types state no limits are ignored; `table` is its name, for the message.
    """
    for name, (length, limits) in _limited_fields(config.__class__).items():
        value = getattr(config, name)
        numbers = value if isinstance(value, tuple) else (value,)
        is_complete = isinstance(value, tuple) == (length > 0) and len(numbers) == max(length, 1)
        if not (is_complete and limits.hold(*numbers)):
            _refuse(table, name, limits.described(length), list(value) if isinstance(value, tuple) else value)


def check_parts(table: str, config: Any, *names: str) -> None:
    """Raises a `UsageError` if shares that exclude each other sum to more than 1."""
    total = sum(getattr(config, name) for name in names)
    if total > 1 + 1e-9:
        _refuse(table, names[0], f"at most 1 together with {', '.join(names[1:])}", round(total, 6))


def check_weights(table: str, config: Any, *names: str) -> None:
    """Raises a `UsageError` if no weight is above 0."""
    if not any(getattr(config, name) for name in names):
        _refuse(table, names[0], f"a number above 0 here or for {', '.join(names[1:])}", "none")


@cache
def _limited_fields(kind: type) -> dict[str, tuple[int, Limits]]:
    """For each field with limits in its type: length of its list (0 for a single number), and the limits."""
    hints = get_type_hints(kind, include_extras=True)
    limited: dict[str, Any] = {name: get_args(hint) for name, hint in hints.items() if get_origin(hint) is Annotated}
    return {name: (len(get_args(numbers)), limits) for name, (numbers, limits) in limited.items()}


def _refuse(table: str, name: str, expected: str, found: object) -> None:
    raise UsageError(f"{table}.{name}: expected {expected}, found {found}")
