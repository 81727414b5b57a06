"""The pictures of an evaluation: error curves, errors of landmarks drawn on a face, sheets of the worst and best."""

import io
from collections.abc import Mapping, Sequence
from html import escape

import cv2
import numpy as np
from jaxtyping import Float, Float64, UInt8
from matplotlib.figure import Figure
from numpy import ndarray

from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace
from pix2face.evaluation.evaluator import FaceResult
from pix2face.evaluation.figures.detection_summary import DetectionSummary
from pix2face.evaluation.report.evaluation_report import Report
from pix2face.geometry.crops import FaceBox, crop_image, square_crop
from pix2face.geometry.landmark_metrics import POINT_SETS, error_curve
from pix2face.geometry.landmarks import CLOSED_GROUPS, IBUG68_GROUPS

Cases = Sequence[tuple[BenchmarkFace, FaceResult]]

MARKED_POINTS = 30  # a curve of fewer points shows each
COLOURS, STYLES = ("tab:blue", "tab:gray"), ("-", "--")

# The drawn face and the colour scale below it.
WIDTH_PX, MARGIN_PX, LARGEST_RADIUS_PX, SMALLEST_RADIUS_PX = 520, 30, 11.0, 2.0
SCALE_PX, SCALE_STEPS, SCALE_LABELS = 14, 40, 4

# Sheets of faces.
TILE_PX, CAPTION_PX, HEADING_PX, COLUMNS = 280, 40, 56, 4
CROP_SCALE = 1.8  # wide enough to show where a fit went instead
TRUE_RGB, FOUND_RGB = (40, 220, 40), (240, 40, 40)
UNREADABLE_GREY = 128
# OpenCV draws with integer coordinates that carry this many fractional bits.
SHIFT_BITS = 4


def curve_png(report: Report) -> bytes:
    """The share of faces by error, for both methods and both point sets, as the content of a PNG file."""
    curves = {
        f"{method}, {points} points": error_curve(report.errors(points, method), report.manifest.threshold) * 100
        for method in report.methods
        for points in POINT_SETS
    }
    return _curves_png(curves, report.title, f"mean error of a face, % of {report.normaliser}", len(report.results))


def curve3d_png(report: Report) -> bytes | None:
    """The share of faces by mean distance in space; None where the truth or the method has no 3D landmarks."""
    if not report.rows3d or report.manifest.threshold3d is None:
        return None
    found = [own.distances3d.mean() for own in report.results if own.distances3d is not None]
    baseline = [own.baseline_distances3d.mean() for own in report.results if own.baseline_distances3d is not None]
    is_share = report.settings.alignment == "depth"
    curves = {
        f"{method}, 68 points": error_curve(np.array(values), report.manifest.threshold3d)
        * [100 if is_share else 1, 100]
        for method, values in zip(report.methods, (found, baseline), strict=True)
    }
    unit = f"% of {report.unit3d}" if is_share else "the data's unit"
    words = f"mean distance of a face in 3D after alignment ({report.settings.alignment}),\n{unit}"
    return _curves_png(curves, report.title, words, len(found))


def precision_png(detection: DetectionSummary, title: str) -> bytes:
    """Precision over recall of a detector's candidates, from the surest on; PNG."""
    figure = Figure(figsize=(6.4, 4.5), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    points = 100 * np.array([point[1:] for point in detection.curve]).reshape(-1, 2)
    axes.plot(*points.T, color=COLOURS[0], marker="." if len(points) < MARKED_POINTS else "")
    axes.set(
        xlim=(0, 101), ylim=(0, 101), xlabel="recall, % of the annotated faces", ylabel="precision, %", title=title
    )
    axes.grid(visible=True, alpha=0.3)
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()


def face_svg(mean: Float64[ndarray, "68"], face: Float64[ndarray, "68 2"], unit: str = "%") -> str:
    """The mean error of each landmark (a fraction, or NaN) as a disc on a face, above a colour scale; SVG for a page.

    The face is the landmarks of the mean face seen from the front, in any unit, x right and y down.
    """
    low, high = face.min(axis=0), face.max(axis=0)
    places = (face - low) * ((WIDTH_PX - 2 * MARGIN_PX) / (high[0] - low[0])) + MARGIN_PX
    bottom = int(places[:, 1].max() + MARGIN_PX)
    lines = "".join(
        f'<path d="M{_path(places[list(indices)])}{"Z" if group in CLOSED_GROUPS else ""}"/>'
        for group, indices in IBUG68_GROUPS.items()
    )
    largest = float(np.nanmax(mean)) if np.isfinite(mean).any() else 0.0
    return (
        f'<svg viewBox="0 0 {WIDTH_PX} {bottom + 5 * SCALE_PX}" width="{WIDTH_PX}" role="img" '
        f'aria-label="Error of each landmark" font-size="13"><g fill="none" stroke="#bbb">{lines}</g>'
        f"{_discs(mean, places, largest)}{_colour_scale(largest, bottom, unit)}</svg>"
    )


def cases_sheet(cases: Cases, heading: str = "") -> UInt8[ndarray, "h w 3"]:
    """Faces in the order of the cases below a heading, with their true (green) and found (red) landmarks."""
    tiles = [_tile(face, result) for face, result in cases]
    columns = min(COLUMNS, max(len(tiles), 1))
    blank = np.full((TILE_PX + CAPTION_PX, TILE_PX, 3), 255, dtype=np.uint8)
    tiles += [blank] * (-len(tiles) % columns or columns * (not tiles))
    rows = [np.hstack(tiles[start : start + columns]) for start in range(0, len(tiles), columns)]
    title = np.full((HEADING_PX, columns * TILE_PX, 3), 255, dtype=np.uint8)
    _write(title, heading, 22, 0.55)
    _write(title, "green: true landmarks; red: found landmarks", 44, 0.42)
    return np.vstack([title, *rows])


def draw_outlined_landmarks(
    image: UInt8[ndarray, "h w 3"], landmarks2d: Float[ndarray, "68 2"], colour: tuple[int, int, int]
) -> None:
    """Draws the 68 landmarks with their contours into a picture."""
    # Centres at +0.5 become OpenCV's integers at centres.
    fixed = np.rint((np.clip(landmarks2d, -1e4, 1e4) - 0.5) * (1 << SHIFT_BITS)).astype(np.int32)
    for group, indices in IBUG68_GROUPS.items():
        line = fixed[list(indices)].reshape(-1, 1, 2)
        cv2.polylines(image, [line], group in CLOSED_GROUPS, colour, 1, cv2.LINE_AA, SHIFT_BITS)
    for x, y in fixed.tolist():
        cv2.circle(image, (x, y), 2 << SHIFT_BITS, colour, -1, cv2.LINE_AA, SHIFT_BITS)


def _curves_png(curves: Mapping[str, Float64[ndarray, "n 2"]], title: str, xlabel: str, n_faces: int) -> bytes:
    """Curves of the first method in one colour, those of the second in another; a style for each point set."""
    figure = Figure(figsize=(6.4, 4.5), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    n_styles = len(curves) // len(COLOURS)
    for index, (label, curve) in enumerate(curves.items()):
        axes.plot(*curve.T, STYLES[index % n_styles], color=COLOURS[index // n_styles], label=label)
    right = max(float(curve[-1, 0]) for curve in curves.values())
    axes.set(xlim=(0, right), ylim=(0, 100), ylabel=f"faces with at most this error, % of {n_faces}", title=title)
    axes.set_xlabel(xlabel, fontsize="small")
    axes.grid(visible=True, alpha=0.3)
    axes.legend(loc="upper left", fontsize="small")
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()


def _discs(mean: Float64[ndarray, "68"], places: Float64[ndarray, "68 2"], largest: float) -> str:
    discs = []
    for index, ((x, y), error) in enumerate(zip(places.tolist(), mean.tolist(), strict=True)):
        share = error / largest if np.isfinite(error) and largest > 0 else 0.0
        # Area follows the error, so that twice the error looks twice as much.
        radius = max(LARGEST_RADIUS_PX * np.sqrt(share), SMALLEST_RADIUS_PX)
        text = f"point {index + 1}: {100 * error:.2f} %" if np.isfinite(error) else f"point {index + 1}: unknown"
        discs.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{_colour(share)}" '
            f'fill-opacity=".75"><title>{escape(text)}</title></circle>'
        )
    return "".join(discs)


def _colour_scale(largest: float, top: int, unit: str) -> str:
    """A bar from 0 to the largest error, with labels and their unit."""
    width = WIDTH_PX - 2 * MARGIN_PX
    step = width / SCALE_STEPS
    bar = "".join(
        f'<rect x="{MARGIN_PX + k * step:.1f}" y="{top}" width="{step + 0.5:.1f}" height="{SCALE_PX}" '
        f'fill="{_colour((k + 0.5) / SCALE_STEPS)}"/>'
        for k in range(SCALE_STEPS)
    )
    shares = np.linspace(0, 1, SCALE_LABELS + 1).tolist()
    labels = "".join(
        f'<text x="{MARGIN_PX + share * width:.0f}" y="{top + 2 * SCALE_PX}">{100 * share * largest:.1f}</text>'
        for share in shares
    )
    middle = f'<text x="{WIDTH_PX / 2:.0f}" y="{top + 3.4 * SCALE_PX:.0f}">mean error, {escape(unit)}</text>'
    return f'{bar}<g text-anchor="middle">{labels}{middle}</g>'


def _colour(share: float) -> str:
    """From blue (no error) to red (the largest)."""
    return f"hsl({200 - 200 * share:.0f},75%,45%)"


def _path(points: Float64[ndarray, "n 2"]) -> str:
    return "L".join(f"{x:.1f} {y:.1f}" for x, y in points.tolist())


def _tile(face: BenchmarkFace, result: FaceResult) -> UInt8[ndarray, "h w 3"]:
    crop = square_crop(FaceBox.around(face.landmarks2d), CROP_SCALE, TILE_PX)
    picture = np.full((TILE_PX, TILE_PX, 3), UNREADABLE_GREY, dtype=np.uint8)
    if face.image is not None:
        picture = crop_image(face.image, crop).copy()
    draw_outlined_landmarks(picture, crop.to_crop(face.landmarks2d), TRUE_RGB)
    if result.landmarks2d is not None:
        draw_outlined_landmarks(picture, crop.to_crop(result.landmarks2d), FOUND_RGB)
    caption = np.full((CAPTION_PX, TILE_PX, 3), 255, dtype=np.uint8)
    error = "not found" if result.failure is not None else f"error {100 * result.error():.1f} %"
    yaw = "" if face.yaw_deg is None else f", yaw {face.yaw_deg:.0f} degrees"
    for line, text in enumerate((error + yaw, face.name)):
        _write(caption, text, 15 + 17 * line)
    return np.vstack([picture, caption])


def _write(image: UInt8[ndarray, "h w 3"], text: str, baseline_px: int, size: float = 0.42) -> None:
    drawable = text.encode("ascii", "replace").decode()[: image.shape[1] // 7]  # OpenCV's letters are ASCII
    cv2.putText(image, drawable, (4, baseline_px), cv2.FONT_HERSHEY_SIMPLEX, size, (0, 0, 0), 1, cv2.LINE_AA)
