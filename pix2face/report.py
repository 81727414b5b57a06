"""Draws an evaluation: the table for a terminal, and a folder with JSON, error curve, page and worst cases."""

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
from jaxtyping import UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy import ndarray
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from pix2face.benchmark_data import BenchmarkFace
from pix2face.command_line import counted
from pix2face.errors import UsageError
from pix2face.evaluation import FaceResult
from pix2face.evaluation_report import BASELINE, BASELINE_RULE, NETWORK, Report, ReportRow, report_as_json
from pix2face.metrics import ErrorSummary, Normaliser, error_curve
from pix2face.report_page import report_page
from pix2face.worst_cases import worst_cases_sheet

N_NAMES_SHOWN = 10
NO_FIGURE = "–"
NORMALISERS: dict[Normaliser, str] = {
    "outer-eye": "distance of the true outer eye corners",
    "inter-pupil": "distance of the means of the six true points of each eye",
    "box-sqrt": "sqrt(width x height) of the tight box of the true 68 points",
    "box-diagonal": "diagonal of the tight box of the true 68 points",
}


def write_report(report: Report, worst: Sequence[tuple[BenchmarkFace, FaceResult]], folder: Path) -> list[Path]:
    """Writes ``report.json``, ``curve.png``, ``worst.jpg`` and ``index.html``.

    Args:
        report: The evaluation.
        worst: The worst cases with their pictures, worst first.
        folder: Where they go; made where it is not there.

    Returns:
        The files written.

    Raises:
        UsageError: The folder cannot be written to.
    """
    columns, lines = table_cells(report)
    contents = {
        "report.json": json.dumps(report_as_json(report), indent=1, allow_nan=False).encode(),
        "worst.jpg": _jpeg(worst_cases_sheet(worst)),
        "index.html": report_page(report.manifest.title, columns, lines, report_notes(report)).encode(),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            (folder / name).write_bytes(content)
        _draw_curve(report, folder / "curve.png")
    except OSError as error:
        raise UsageError(f"{folder}: expected a folder that the report can be written to ({error.strerror})") from error
    return [folder / name for name in ("report.json", "curve.png", "worst.jpg", "index.html")]


def table_cells(report: Report) -> tuple[list[str], list[list[str]]]:
    """Headings and lines of the table, as text; errors in per cent."""
    groups = list(report.rows[0].groups)
    threshold = f"{100 * report.manifest.threshold:g} %"
    is_binned = report.manifest.groups == "yaw"
    columns = ["in %", "points", *(groups if len(groups) > 1 else []), *(["mean of bins"] if is_binned else [])]
    columns += ["mean over images", "median", f"AUC to {threshold}", f"above {threshold}", "no fit"]
    lines = [_line(row, with_groups=len(groups) > 1, is_binned=is_binned) for row in report.rows]
    counts = ["images", NO_FIGURE, *(str(report.rows[0].groups[group].n_images) for group in groups if len(groups) > 1)]
    counts += [NO_FIGURE] * is_binned + [str(len(report.results)), *[NO_FIGURE] * 4]
    return columns, [*lines, counts]


def report_table(report: Report) -> Table:
    """The table for a terminal."""
    columns, lines = table_cells(report)
    table = Table(title=escape(report.manifest.title), box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for i, column in enumerate(columns):
        table.add_column(
            escape(column),
            justify="left" if i == 0 else "right",
            vertical="bottom",
            width=_width(column, [line[i] for line in lines]),
        )
    for line in lines:
        table.add_row(*(escape(cell) for cell in line))
    return table


def _width(column: str, cells: Sequence[str]) -> int:
    """Columns of a terminal without which a heading's word or a figure would be cut."""
    return max(len(word) for word in (*column.split(), *cells))


def report_notes(report: Report) -> list[str]:
    """Everything without which the table says little, a line each: plain text."""
    manifest = report.manifest
    notes = [
        f"Evaluated {len(report.results)} of {manifest.n_samples} images of {manifest.split}.",
        f"Truth: {manifest.ground_truth}.",
        f"Error: mean distance over 68 points (51: without the jaw) / {NORMALISERS[manifest.normaliser]} "
        f"[{manifest.normaliser}], in %.",
        f"Box of the crop: {manifest.box_rule}.",
        f"Row {NETWORK}: landmarks of the fit to the maps. Row {BASELINE}: {BASELINE_RULE}.",
        "A failed fit counts as an error above every threshold; means and medians are over the successes.",
    ]
    if manifest.groups == "yaw":
        notes.insert(
            3, "Mean of bins: unweighted mean of the three bins of |yaw| (0 to 30, to 60, above), the headline."
        )
    if report.n_unusual_angles:
        notes.append(
            f"{counted(report.n_unusual_angles, 'image')} with an angle beyond ±99° in the truth: "
            "kept, in the bin of the |yaw| wrapped to 180°."
        )
    notes += [f"{key}: {value}" for key, value in report.subject.items() if isinstance(value, str)]
    return notes + _map_notes(report) + _lists(report)


def _map_notes(report: Report) -> list[str]:
    maps = report.maps
    if maps is None:
        return []
    return [
        "Maps, means over images of the mean distance over the pixels of the crop that truth and prediction call face: "
        f"PNCC {_number(maps.pncc_mm, 1)} mm, offset {_number(maps.offset_mm, 1)} mm "
        f"(predicting no offset: {_number(maps.offset_baseline_mm, 1)} mm), mask IoU {maps.mask_iou:.3f}."
    ]


def _lists(report: Report) -> list[str]:
    notes = []
    failed = [f"{result.name} ({result.failure})" for result in report.results if result.failure is not None]
    unreadable = [f"{face.name} ({face.reason})" for face in report.unreadable]
    for what, names in (("missing", list(report.missing)), ("unreadable", unreadable), ("without a fit", failed)):
        if names:
            more = len(names) - N_NAMES_SHOWN
            shown = ", ".join(names[:N_NAMES_SHOWN]) + (f" and {more} more (all in report.json)" if more > 0 else "")
            notes.append(f"{len(names)} {what}: {shown}.")
    return notes


def _line(row: ReportRow, *, with_groups: bool, is_binned: bool) -> list[str]:
    cells = [row.method, row.points]
    if with_groups:
        cells += [_number(summary.mean) for summary in row.groups.values()]
    if is_binned:
        cells.append(_number(row.mean_of_groups))
    summary: ErrorSummary = row.all_images
    cells += [_number(summary.mean), _number(summary.median)]
    cells += [_number(value, digits=1) for value in (summary.area_under_curve, summary.failure_rate)]
    return [*cells, str(summary.n_failed)]


def _number(value: float | None, factor: float = 100, digits: int = 2) -> str:
    return NO_FIGURE if value is None else f"{factor * value:.{digits}f}"


def _jpeg(image: UInt8[ndarray, "h w 3"]) -> bytes:
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1])


def _draw_curve(report: Report, path: Path) -> None:
    """Fraction of faces by error, for both methods and both point sets."""
    figure = Figure(figsize=(6, 4.5), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    threshold = report.manifest.threshold
    for method, colour in ((NETWORK, "tab:blue"), (BASELINE, "tab:gray")):
        for points, style in (("68", "-"), ("51", "--")):
            curve = 100 * error_curve(report.errors(points, method), threshold)
            axes.plot(curve[:, 0], curve[:, 1], style, color=colour, label=f"{method}, {points} points")
    axes.set(
        xlim=(0, 100 * threshold),
        ylim=(0, 100),
        xlabel=f"error, % of {report.manifest.normaliser}",
        ylabel=f"% of {len(report.results)} faces with at most this error",
        title=report.manifest.title,
    )
    axes.grid(visible=True, alpha=0.3)
    axes.legend(loc="upper left", fontsize="small")
    figure.savefig(path)
