"""Writes an evaluation: ``report.json``, a page that needs no other file, its pictures, and the landmarks found."""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.evaluation.evaluator import BASELINE, FaceResult
from pix2face.evaluation.figures.bootstrap import CONFIDENCE
from pix2face.evaluation.figures.detection_summary import DetectionSummary, RecallBin
from pix2face.evaluation.report.evaluation_report import BASELINE_RULE, Report
from pix2face.evaluation.report.report_pictures import (
    Cases,
    cases_sheet,
    curve3d_png,
    curve_png,
    face_svg,
    precision_png,
)
from pix2face.evaluation.report.report_text import all_tables, report_notes
from pix2face.evaluation.report.table_text import ReportTable
from pix2face.evaluation.subjects.predictions_file import Predictions, write_predictions
from pix2face.files.html_parts import data_url
from pix2face.files.images import encode_photograph
from pix2face.files.writing import write_file
from pix2face.geometry.landmark_metrics import ALIGNMENTS, POINT_SETS
from pix2face.geometry.landmarks import IBUG68_PARTS

SCHEMA_VERSION = 2
FORMAT = "pix2face-evaluation"
# Of more faces (frames of video) the error of each single landmark is left out: landmarks.npz tells it in less space.
MOST_FACES_IN_FULL = 5000

_STYLE = """
body { font-family: sans-serif; margin: 2em auto; max-width: 75em; color: #222; line-height: 1.4; }
table { border-collapse: collapse; margin-bottom: 1.6em; } caption { text-align: left; padding: .4em 0; color: #444; }
th, td { padding: .3em .8em; border-bottom: 1px solid #ccc; text-align: right; }
th:first-child, td:first-child { text-align: left; } img, svg { max-width: 100%; height: auto; }
"""


def write_report(
    report: Report, worst: Cases, best: Cases, frontal_face: Float64[ndarray, "68 2"], folder: Path
) -> list[Path]:
    """Writes ``index.html``, ``report.json``, ``landmarks.npz``, ``curve.png``, ``worst.jpg`` and ``best.jpg``.

    The folder is made where it is missing. ``frontal_face`` is the mean face, on which errors are drawn.

    Raises:
        UsageError: The folder cannot be written to.
    """
    errors_of = f"{report.title}: mean errors in % of {report.normaliser}"
    contents = {
        "report.json": json.dumps(report_as_json(report), indent=1, allow_nan=False).encode(),
        "curve.png": curve_png(report),
        "worst.jpg": encode_photograph(cases_sheet(worst, f"Worst cases. {errors_of}")),
        "best.jpg": encode_photograph(cases_sheet(best, f"Best cases. {errors_of}")),
    }
    in_space = curve3d_png(report)
    if in_space is not None:
        contents["curve3d.png"] = in_space
    if report.detection is not None:
        contents["detection.png"] = precision_png(report.detection, report.manifest.title)
    contents["index.html"] = _page(report, contents, frontal_face).encode()
    try:
        for name, content in contents.items():
            write_file(folder / name, content)
        _write_landmarks(report, folder / "landmarks.npz")
    except OSError as error:
        raise UsageError(f"{folder}: expected a folder that the report can be written to ({error.strerror})") from error
    return [folder / name for name in (*contents, "landmarks.npz")]


def report_as_json(report: Report) -> dict[str, Any]:
    """The report as plain data for a JSON file. Errors are fractions; that of a face that was not found is null."""
    facts = {**asdict(report.manifest), "title": report.title}
    for lists in ("parts", "landmark_indices", "other_truths", "reannotated_files", "pictures_in", "by"):
        del facts[lists]  # the manifest has them
    settings = report.settings
    return {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "benchmark": facts,
        "method": settings.method,
        "landmark_type": settings.landmark_type,
        "baseline": BASELINE_RULE,
        "bootstrap": {
            **asdict(settings.bootstrap),
            "confidence": CONFIDENCE,
            "drawn": "clips" if any(result.clip is not None for result in report.results) else "images",
        },
        "subject": report.subject,
        "n_evaluated": len(report.results),
        "n_missing": len(report.missing),
        "n_unreadable": len(report.unreadable),
        "n_failed": report.n_failed,
        "n_angles_beyond_99_deg": report.n_unusual_angles,
        "table": [asdict(row) for row in report.rows],
        "parts": {
            method: {part: _number(value) for part, value in report.mean_of_parts(method).items()}
            for method in report.methods
        },
        "landmarks": {method: _numbers(report.mean_of_landmarks(method)) for method in report.methods},
        "by": [asdict(own) for own in report.by],
        "table3d": _table3d(report),
        "poses": None if report.poses is None else {name: asdict(own) for name, own in report.poses.items()},
        "detection": _detection_as_json(report.detection),
        "map_errors": None if report.maps is None else asdict(report.maps),
        "coefficient_errors": None if report.coefficients is None else asdict(report.coefficients),
        "missing": list(report.missing),
        "unreadable": [asdict(face) for face in report.unreadable],
        "faces": [_face_as_json(result, len(report.results) <= MOST_FACES_IN_FULL) for result in report.results],
    }


def _table3d(report: Report) -> dict[str, Any] | None:
    if not report.rows3d:
        return None
    alignment = report.settings.alignment
    return {
        "unit": report.unit3d,
        "alignment": alignment,
        "alignment_in_words": ALIGNMENTS[alignment],
        "threshold": report.manifest.threshold3d,
        "table": [asdict(row) for row in report.rows3d],
    }


def _detection_as_json(detection: DetectionSummary | None) -> dict[str, Any] | None:
    if detection is None:
        return None
    names = ("score", "recall", "precision")
    curve = [dict(zip(names, point, strict=True)) for point in detection.curve]
    return asdict(detection) | {
        "all_faces": _bin_as_json(detection.all_faces),
        "by_yaw": [_bin_as_json(own) for own in detection.by_yaw],
        "by_size": [_bin_as_json(own) for own in detection.by_size],
        "false_per_photograph": detection.false_per_photograph,
        "curve": curve,
    }


def _bin_as_json(own: RecallBin) -> dict[str, Any]:
    return asdict(own) | {"recall": own.recall}


def _face_as_json(result: FaceResult, is_in_full: bool) -> dict[str, Any]:
    errors = result.landmark_errors
    return {
        "name": result.name,
        "group": result.group,
        "clip": result.clip,
        "yaw_deg": result.yaw_deg,
        "has_unusual_angle": result.has_unusual_angle,
        "errors": {points: _number(result.error(points)) for points in POINT_SETS},
        "baseline": {points: _number(result.error(points, BASELINE)) for points in POINT_SETS},
        "parts": {part: _number(errors[list(indices)].mean()) for part, indices in IBUG68_PARTS.items()},
        "landmarks": _numbers(errors.round(6)) if is_in_full else None,
        "failure": result.failure,
        "pose_deg": None if result.pose_deg is None else _numbers(result.pose_deg),
        "distance3d": None if result.distances3d is None else _number(result.distances3d.mean()),
        "detection": None if result.detection is None else asdict(replace(result.detection, candidates=())),
        "maps": None if result.maps is None else asdict(result.maps),
        "coefficients": None if result.coefficients is None else asdict(result.coefficients),
    }


def _numbers(values: Float[ndarray, " n"]) -> list[float | None]:
    return [_number(value) for value in values.tolist()]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _write_landmarks(report: Report, path: Path) -> None:
    """Writes the landmarks as predictions of a system, so that they can be measured again by other rules."""
    if not report.results:
        path.unlink(missing_ok=True)
        return
    nothing, no_pose = np.full((68, 2), np.nan), np.full(3, np.nan)
    landmarks = [nothing if result.landmarks2d is None else result.landmarks2d for result in report.results]
    poses = [no_pose if result.pose_deg is None else result.pose_deg for result in report.results]
    has_pose = any(result.pose_deg is not None for result in report.results)
    has_depth = report.settings.alignment == "depth" and any(result.z_px is not None for result in report.results)
    depths = [nothing[:, 0] if result.z_px is None else result.z_px for result in report.results]
    found = Predictions(
        source=path,
        names=tuple(result.name for result in report.results),
        landmarks2d=np.stack(landmarks),
        z_px=np.stack(depths) if has_depth else None,
        pose_deg=np.stack(poses) if has_pose else None,
    )
    write_predictions(path, found)


def _page(report: Report, contents: Mapping[str, bytes], frontal_face: Float64[ndarray, "68 2"]) -> str:
    """One HTML file that needs nothing beside it and nothing from the network; every text is escaped."""
    title, method = escape(report.title), report.settings.method
    subject = next(
        (report.subject[key] for key in ("checkpoint", "predictions", "oracle") if key in report.subject), ""
    )
    measured = f"{method}: {subject}. " if subject else ""
    written = f"{measured}Evaluated on {datetime.now(UTC):%Y-%m-%d at %H:%M} UTC."
    tables = "\n".join(table_html(table) for table in all_tables(report))
    notes = "\n".join(f"<li>{escape(note)}</li>" for note in report_notes(report))
    sections = [
        ("Error curve", _picture(contents["curve.png"], "png", "Cumulative error distribution")),
        (
            f"Mean error of each landmark (row {escape(method)})",
            "<p>The area and the colour of a disc follow the error; point at a disc for its number (from 1) and its "
            f"error.</p>{face_svg(report.mean_of_landmarks(method), frontal_face, f'% of {report.normaliser}')}",
        ),
        ("Worst cases", _picture(contents["worst.jpg"], "jpeg", "Worst cases")),
        ("Best cases", _picture(contents["best.jpg"], "jpeg", "Best cases")),
    ]
    if "curve3d.png" in contents:
        curve3d = _picture(contents["curve3d.png"], "png", "Cumulative distribution of distances in 3D")
        sections.insert(1, ("Error curve in 3D", curve3d))
    if "detection.png" in contents:
        picture = _picture(contents["detection.png"], "png", "Precision of the detector over its recall")
        sections.insert(1, ("Precision and recall of the detector", picture))
    shown = "\n".join(f"<h2>{heading}</h2>{content}" for heading, content in sections)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>{_STYLE}</style></head><body>
<h1>{title}</h1>
<p>{escape(written)}</p>
{tables}
<ul>
{notes}
</ul>
{shown}
</body></html>
"""


def table_html(table: ReportTable) -> str:
    """A table with its caption; every text is escaped."""
    head = "".join(f"<th>{escape(column)}</th>" for column in table.columns)
    rows = ("".join(f"<td>{escape(cell)}</td>" for cell in line) for line in table.lines)
    body = "\n".join(f"<tr>{row}</tr>" for row in rows)
    caption = f"<caption>{escape(table.caption)}</caption>" if table.caption else ""
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table>"


def _picture(content: bytes, kind: str, description: str) -> str:
    return f'<p><img src="{data_url(kind, content)}" alt="{escape(description)}"></p>'
