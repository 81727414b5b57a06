"""The pictures of an evaluation: the error curve, and the errors of the landmarks drawn on a face."""

import io
from html import escape

import numpy as np
from jaxtyping import Float64
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy import ndarray

from pix2face.evaluation.report.evaluation_report import Report
from pix2face.geometry.landmark_metrics import error_curve
from pix2face.geometry.landmarks import CLOSED_GROUPS, IBUG68_GROUPS

COLOURS = ("tab:blue", "tab:gray")
# Of the drawn face.
WIDTH_PX, MARGIN_PX, LARGEST_RADIUS_PX, SMALLEST_RADIUS_PX = 520, 30, 11.0, 2.0


def curve_png(report: Report) -> bytes:
    """Fraction of faces by error, for both methods and both point sets, as the content of a PNG file."""
    figure = Figure(figsize=(6, 4.5), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    threshold = report.manifest.threshold
    for method, colour in zip(report.methods, COLOURS, strict=True):
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
    return _as_png(figure)


def curve3d_png(report: Report) -> bytes | None:
    """Fraction of faces by mean distance in space; None where the truth has no 3D landmarks."""
    distances = [result.distances3d.mean() for result in report.results if result.distances3d is not None]
    baseline = [
        result.baseline_distances3d.mean() for result in report.results if result.baseline_distances3d is not None
    ]
    if not distances or report.manifest.threshold3d is None:
        return None
    figure = Figure(figsize=(6, 4.5), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for values, method, colour in zip((distances, baseline), report.methods, COLOURS, strict=True):
        curve = error_curve(np.array(values), report.manifest.threshold3d)
        axes.plot(curve[:, 0], 100 * curve[:, 1], color=colour, label=f"{method}, 68 points")
    axes.set(
        xlim=(0, report.manifest.threshold3d),
        ylim=(0, 100),
        xlabel=f"mean distance in 3D, the data's unit, alignment {report.settings.alignment}",
        ylabel=f"% of {len(distances)} faces with at most this distance",
        title=report.manifest.title,
    )
    return _as_png(figure)


def face_svg(mean: Float64[ndarray, "68"], face: Float64[ndarray, "68 2"]) -> str:
    """The mean error of each landmark as a disc on a face, largest for the largest; SVG for a page.

    Args:
        mean: Fractions; NaN where unknown.
        face: The mean face's landmarks seen from the front, any unit, x right, y down.
    """
    low, high = face.min(axis=0), face.max(axis=0)
    scale = (WIDTH_PX - 2 * MARGIN_PX) / (high[0] - low[0])
    places = (face - low) * scale + MARGIN_PX
    height = int(places[:, 1].max() + MARGIN_PX)
    lines = "".join(
        f'<path d="M{_path(places[list(indices)])}{"Z" if group in CLOSED_GROUPS else ""}"/>'
        for group, indices in IBUG68_GROUPS.items()
    )
    return (
        f'<svg viewBox="0 0 {WIDTH_PX} {height}" width="{WIDTH_PX}" role="img" aria-label="Error of each landmark">'
        f'<g fill="none" stroke="#bbb">{lines}</g>{_discs(mean, places)}</svg>'
    )


def _discs(mean: Float64[ndarray, "68"], places: Float64[ndarray, "68 2"]) -> str:
    largest = float(np.nanmax(mean)) if np.isfinite(mean).any() else 1.0
    discs = []
    for index, ((x, y), error) in enumerate(zip(places.tolist(), mean.tolist(), strict=True)):
        share = error / largest if np.isfinite(error) and largest > 0 else 0.0
        # Area follows the error, so that twice the error looks twice as much.
        radius = max(LARGEST_RADIUS_PX * np.sqrt(share), SMALLEST_RADIUS_PX)
        text = f"point {index + 1}: {100 * error:.2f} %" if np.isfinite(error) else f"point {index + 1}: unknown"
        discs.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="hsl({200 - 200 * share:.0f},75%,45%)" '
            f'fill-opacity=".75"><title>{escape(text)}</title></circle>'
        )
    return "".join(discs)


def _path(points: Float64[ndarray, "n 2"]) -> str:
    return "L".join(f"{x:.1f} {y:.1f}" for x, y in points.tolist())


def _as_png(figure: Figure) -> bytes:
    (axes,) = figure.axes
    axes.grid(visible=True, alpha=0.3)
    axes.legend(loc="upper left", fontsize="small")
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()
