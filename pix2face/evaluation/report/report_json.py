"""An evaluation as plain data: every figure of its tables and of every face, and what is needed to repeat it."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from pix2face.evaluation.evaluator import FaceResult
from pix2face.evaluation.figures.bootstrap import CONFIDENCE
from pix2face.evaluation.report.evaluation_report import BASELINE_RULE, Report, ReportRow
from pix2face.geometry.alignment3d import ALIGNMENTS
from pix2face.geometry.landmark_metrics import PARTS, POINT_SETS

SCHEMA_VERSION = 2
FORMAT = "pix2face-evaluation"
# Of more faces (frames of video) the error of each single landmark is left out: landmarks.npz tells it in less space.
MOST_FACES_IN_FULL = 5000


def report_as_json(report: Report) -> dict[str, Any]:
    """The report as plain data for a JSON file. Errors are fractions; that of a face that was not found is null."""
    facts = asdict(report.manifest)
    for lists in ("parts", "landmark_indices", "other_truths", "reannotated_files", "pictures_in", "by"):
        del facts[lists]  # the manifest has them
    settings = report.settings
    return {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "benchmark": facts,
        "method": settings.method,
        "contour": settings.contour,
        "baseline": BASELINE_RULE,
        "bootstrap": {**asdict(settings.bootstrap), "confidence": CONFIDENCE, "drawn": _what_is_drawn(report)},
        "subject": report.subject,
        "n_evaluated": len(report.results),
        "n_missing": len(report.missing),
        "n_unreadable": len(report.unreadable),
        "n_failed": report.n_failed,
        "n_angles_beyond_99_deg": report.n_unusual_angles,
        "table": [asdict(row) for row in report.rows],
        "parts": {method: _known(report.mean_of_parts(method)) for method in report.methods},
        "landmarks": {method: _numbers(report.mean_of_landmarks(method)) for method in report.methods},
        "by": [asdict(own) for own in report.by],
        "table3d": _table3d(report.rows3d, report),
        "poses": None if report.poses is None else {name: asdict(own) for name, own in report.poses.items()},
        "map_errors": None if report.maps is None else asdict(report.maps),
        "coefficient_errors": None if report.coefficients is None else asdict(report.coefficients),
        "missing": list(report.missing),
        "unreadable": [asdict(face) for face in report.unreadable],
        "faces": [_face_as_json(result, len(report.results) <= MOST_FACES_IN_FULL) for result in report.results],
    }


def _what_is_drawn(report: Report) -> str:
    return "clips" if any(result.clip is not None for result in report.results) else "images"


def _table3d(rows: Sequence[ReportRow], report: Report) -> dict[str, Any] | None:
    if not rows:
        return None
    alignment = report.settings.alignment
    return {
        "unit": "the data's",
        "alignment": alignment,
        "alignment_in_words": ALIGNMENTS[alignment],
        "threshold": report.manifest.threshold3d,
        "table": [asdict(row) for row in rows],
    }


def _face_as_json(result: FaceResult, is_in_full: bool) -> dict[str, Any]:
    errors = result.landmark_errors
    return {
        "name": result.name,
        "group": result.group,
        "clip": result.clip,
        "yaw_deg": result.yaw_deg,
        "has_unusual_angle": result.has_unusual_angle,
        "errors": {points: _number(result.error(points)) for points in POINT_SETS},
        "baseline": {points: _number(result.error(points, "baseline")) for points in POINT_SETS},
        "parts": {part: _number(errors[list(indices)].mean()) for part, indices in PARTS.items()},
        "landmarks": _numbers(errors.round(6)) if is_in_full else None,
        "failure": result.failure,
        "pose_deg": None if result.pose_deg is None else _numbers(result.pose_deg),
        "distance3d": None if result.distances3d is None else _number(result.distances3d.mean()),
        "maps": None if result.maps is None else asdict(result.maps),
        "coefficients": None if result.coefficients is None else asdict(result.coefficients),
    }


def _known(values: dict[str, float]) -> dict[str, float | None]:
    return {name: _number(value) for name, value in values.items()}


def _numbers(values: Float[ndarray, " n"]) -> list[float | None]:
    return [_number(value) for value in values.tolist()]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
