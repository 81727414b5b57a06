"""Tables of a report as text, and the figures in their cells."""

from typing import NamedTuple

from pix2face.evaluation.benchmarks.benchmark_data import YAW_BINS
from pix2face.evaluation.figures.bootstrap import Interval

NO_FIGURE = "–"

# As headings: the columns of a table are narrow.
SHORT_GROUPS = dict(zip(YAW_BINS, ("to 30°", "to 60°", "above"), strict=True))


class ReportTable(NamedTuple):
    """A table as text."""

    caption: str
    columns: list[str]
    lines: list[list[str]]


def interval_text(interval: Interval | None, factor: float = 100) -> str:
    """An interval as text, in per cent if the factor is 100."""
    return NO_FIGURE if interval is None else f"{factor * interval[0]:.2f}–{factor * interval[1]:.2f}"


def number(value: float | None, factor: float = 100, digits: int = 2) -> str:
    """A figure as text, in per cent if the factor is 100."""
    return NO_FIGURE if value is None or value != value else f"{factor * value:.{digits}f}"
