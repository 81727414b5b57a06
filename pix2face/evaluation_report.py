"""What an evaluation says: the rows of its table, its lists, and everything needed to repeat it, as plain data."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.benchmark_data import YAW_BINS, Unreadable
from pix2face.evaluation import FaceResult, MapErrors
from pix2face.manifest import Manifest
from pix2face.metrics import POINT_SETS, ErrorSummary, summarise

SCHEMA_VERSION = 1
NETWORK = "network"
BASELINE = "baseline"
BASELINE_RULE = (
    "the mean face's landmarks seen from the front, scaled alike in both directions so that their tight box has the "
    "area of the true box, centre on centre"
)


@final
@dataclass(frozen=True)
class ReportRow:
    """One row of the table.

    Attributes:
        method: The network, or the baseline.
        points: "68" or "51" (without the jaw).
        groups: For each column what it says of its faces.
        mean_of_groups: Unweighted mean of the columns' means; None where a column is empty or the columns are no bins.
        all_images: Over all faces.
    """

    method: str
    points: str
    groups: dict[str, ErrorSummary]
    mean_of_groups: float | None
    all_images: ErrorSummary


@final
@dataclass(frozen=True, kw_only=True)
class Report:
    """An evaluation.

    Attributes:
        manifest: The benchmark.
        subject: What was evaluated: checkpoint, model, fit, versions.
        rows: The table, network first, each method with all and with inner points.
        maps: Means over the images of the errors of the maps; None where the truth has no maps.
        results: One for each face.
        missing: Faces of the benchmark that are not on disk.
        unreadable: Faces whose files cannot be used.
    """

    manifest: Manifest
    subject: dict[str, Any]
    rows: tuple[ReportRow, ...]
    maps: MapErrors | None
    results: tuple[FaceResult, ...]
    missing: tuple[str, ...]
    unreadable: tuple[Unreadable, ...]

    @property
    def n_unusual_angles(self) -> int:
        """Faces with an angle beyond ±99° in the truth."""
        return sum(result.has_unusual_angle for result in self.results)

    def worst(self, n: int) -> list[FaceResult]:
        """The faces with the largest errors over 68 points, failed ones first."""
        return sorted(self.results, key=lambda result: -result.errors["68"])[:n]

    def errors(self, points: str = "68", method: str = NETWORK) -> Float64[ndarray, " n"]:
        """The error of each face, a fraction."""
        return _errors(self.results, points, method)


def make_report(
    manifest: Manifest,
    subject: dict[str, Any],
    results: Sequence[FaceResult],
    missing: Sequence[str] = (),
    unreadable: Sequence[Unreadable] = (),
) -> Report:
    """Sums up the results of a benchmark."""
    groups = YAW_BINS if manifest.groups == "yaw" else tuple(part.name for part in manifest.parts)
    rows = [
        _make_row(manifest, results, groups, points, method) for method in (NETWORK, BASELINE) for points in POINT_SETS
    ]
    return Report(
        manifest=manifest,
        subject=subject,
        rows=tuple(rows),
        maps=_mean_map_errors([result.maps for result in results if result.maps is not None]),
        results=tuple(results),
        missing=tuple(missing),
        unreadable=tuple(unreadable),
    )


def report_as_json(report: Report) -> dict[str, Any]:
    """The report as plain data for a JSON file. Errors are fractions; that of a failed fit is null."""
    facts = asdict(report.manifest)
    del facts["parts"]  # lists of all names: the manifest has them
    return {
        "schema_version": SCHEMA_VERSION,
        "benchmark": facts,
        "baseline": BASELINE_RULE,
        "subject": report.subject,
        "n_evaluated": len(report.results),
        "n_missing": len(report.missing),
        "n_unreadable": len(report.unreadable),
        "n_failed": sum(result.failure is not None for result in report.results),
        "n_angles_beyond_99_deg": report.n_unusual_angles,
        "table": [asdict(row) for row in report.rows],
        "map_errors": None if report.maps is None else asdict(report.maps),
        "missing": list(report.missing),
        "unreadable": [asdict(face) for face in report.unreadable],
        "faces": [_face_as_json(result) for result in report.results],
    }


def _make_row(
    manifest: Manifest, results: Sequence[FaceResult], groups: Sequence[str], points: str, method: str
) -> ReportRow:
    summaries = {
        group: summarise(
            _errors([result for result in results if result.group == group], points, method), manifest.threshold
        )
        for group in groups
    }
    means = [summary.mean for summary in summaries.values()]
    known = [mean for mean in means if mean is not None]
    is_binned = manifest.groups == "yaw" and len(known) == len(means)
    return ReportRow(
        method=method,
        points=points,
        groups=summaries,
        mean_of_groups=float(np.mean(known)) if is_binned else None,
        all_images=summarise(_errors(results, points, method), manifest.threshold),
    )


def _errors(results: Sequence[FaceResult], points: str, method: str) -> Float64[ndarray, " n"]:
    chosen = [result.errors if method == NETWORK else result.baseline for result in results]
    return np.array([errors[points] for errors in chosen], dtype=np.float64)


def _mean_map_errors(errors: Sequence[MapErrors]) -> MapErrors | None:
    """Means over images; those without a common pixel count in the overlap only."""
    if not errors:
        return None
    return MapErrors(
        pncc_mm=_mean_of_known([error.pncc_mm for error in errors]),
        offset_mm=_mean_of_known([error.offset_mm for error in errors]),
        offset_baseline_mm=_mean_of_known([error.offset_baseline_mm for error in errors]),
        mask_iou=float(np.mean([error.mask_iou for error in errors])),
    )


def _mean_of_known(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _face_as_json(result: FaceResult) -> dict[str, Any]:
    return {
        "name": result.name,
        "group": result.group,
        "yaw_deg": result.yaw_deg,
        "has_unusual_angle": result.has_unusual_angle,
        "errors": {points: error if np.isfinite(error) else None for points, error in result.errors.items()},
        "baseline": dict(result.baseline),
        "failure": result.failure,
        "maps": None if result.maps is None else asdict(result.maps),
    }
