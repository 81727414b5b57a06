"""The content of an evaluation's report: the rows of its tables with their intervals, and its lists."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.command_line import counted
from pix2face.evaluation.benchmarks.benchmark_data import YAW_BINS, Unreadable
from pix2face.evaluation.benchmarks.manifest import Manifest
from pix2face.evaluation.evaluator import BASELINE, FaceResult
from pix2face.evaluation.figures.attribute_bins import AttributeValues, ErrorsByAttribute, errors_by_attribute
from pix2face.evaluation.figures.bootstrap import (
    Bootstrap,
    Interval,
    Statistic,
    cluster_indices,
    intervals,
    mean_of,
    mean_of_statistics,
    median_of,
)
from pix2face.evaluation.figures.detection_summary import DetectionSummary, summarise_detections
from pix2face.evaluation.figures.pose_summary import PoseSummary, summarise_poses
from pix2face.evaluation.subjects.truth_errors import CoefficientErrors, MapErrors, mean_errors
from pix2face.fitting.fit_options import LandmarkType
from pix2face.geometry import Alignment, Normaliser
from pix2face.geometry.landmark_metrics import POINT_SETS, ErrorSummary, summarise
from pix2face.geometry.landmarks import IBUG68_PARTS

NORMALISERS: dict[Normaliser, str] = {
    "outer-eye": "distance of the true outer eye corners",
    "inter-pupil": "distance of the means of the six true points of each eye",
    "box-sqrt": "sqrt(width x height) of the tight box of the true 68 points",
    "box-diagonal": "diagonal of the tight box of the true 68 points",
}
BASELINE_RULE = (
    "the mean face's landmarks seen from the front, scaled alike in both directions so that their tight box has the "
    "area of the true box, centre on centre"
)


@final
@dataclass(frozen=True)
class ReportRow:
    """One row of the table."""

    method: str  # what was measured, or the baseline
    points: str  # "68" or "51" (without the jaw)
    groups: dict[str, ErrorSummary]  # for each column the errors of its faces
    mean_of_groups: float | None  # unweighted mean over the yaw bins; None where one is empty, or without bins
    all_images: ErrorSummary
    mean_failures_as_baseline: float | None  # over all faces; one that was not found has the error of the baseline
    # 95 % intervals of the means of the groups (by name), of ``mean_of_groups``, and over all faces of ``mean``,
    # ``median``, ``area_under_curve`` and ``failure_rate``.
    intervals: dict[str, Interval | None]


@final
@dataclass(frozen=True, kw_only=True)
class EvaluationSettings:
    """What decides the figures, apart from the benchmark and the subject."""

    method: str  # what was measured, in a word
    alignment: Alignment = "rigid"  # how 3D landmarks are aligned with the true ones
    landmark_type: LandmarkType = "3d"  # of the landmarks that were measured; see ``FitOptions``
    bootstrap: Bootstrap = field(default_factory=Bootstrap)
    by: tuple[AttributeValues, ...] = ()  # attributes by which errors are split


@final
@dataclass(frozen=True, kw_only=True)
class Report:
    """An evaluation."""

    manifest: Manifest  # the benchmark, as it was measured
    settings: EvaluationSettings
    subject: dict[str, Any]  # what was evaluated: checkpoint, model, fit, versions
    rows: tuple[ReportRow, ...]  # of each method for all and for inner points; what was measured comes first
    rows3d: tuple[ReportRow, ...]  # the same for distances in 3D, in ``unit3d``; empty without 3D truth
    by: tuple[ErrorsByAttribute, ...]  # errors over 68 points of what was measured, in bins of attributes of renders
    poses: Mapping[str, PoseSummary] | None  # by bin of |yaw|, and for all faces; None without poses
    detection: DetectionSummary | None  # how a detector found the faces; None with true boxes
    maps: MapErrors | None  # means over the images; None where the truth has no maps
    coefficients: CoefficientErrors | None  # likewise
    results: tuple[FaceResult, ...]  # one for each face
    missing: tuple[str, ...]  # faces of the benchmark that are not on disk
    unreadable: tuple[Unreadable, ...]  # faces whose files cannot be used

    @property
    def methods(self) -> tuple[str, str]:
        """What was measured, and the baseline."""
        return self.settings.method, BASELINE

    @property
    def title(self) -> str:
        """The benchmark's name and, where not all of it was evaluated, how much was."""
        manifest, what = self.manifest, "clips" if self.manifest.kind == "clips" else "images"
        if self._n_evaluated < manifest.n_samples:
            return f"{manifest.title}; only {self._n_evaluated} of {manifest.n_samples} {what}"
        return f"{manifest.title}; {counted(len(self.missing), 'frame')} missing" if self.missing else manifest.title

    @property
    def lacks_files(self) -> bool:
        """Whether files of the benchmark are not on disk."""
        lacks_clips = self.manifest.kind == "clips" and self._n_evaluated < self.manifest.n_samples
        return bool(self.missing) or lacks_clips

    @property
    def _n_evaluated(self) -> int:
        """How many of the benchmark's images, or of its clips, were evaluated."""
        if self.manifest.kind != "clips":
            return len(self.results)
        clips = {result.clip for result in self.results}
        named = {clip for part in self.manifest.parts for clip in part.clips}  # none where a clip may have any name
        return len(clips & named if named else clips)

    @property
    def normaliser(self) -> str:
        """What errors are divided by, in words."""
        return f"the {NORMALISERS[self.manifest.normaliser]}"

    @property
    def unit3d(self) -> str:
        """The unit of distances in 3D, in words; fractions of it for landmarks in the picture."""
        return self.normaliser if self.settings.alignment == "depth" else "the data's"

    @property
    def n_failed(self) -> int:
        """Faces that were not found."""
        return sum(result.failure is not None for result in self.results)

    @property
    def n_unusual_angles(self) -> int:
        """Faces with an angle beyond ±99° in the truth."""
        return sum(result.has_unusual_angle for result in self.results)

    def worst(self, n: int) -> list[FaceResult]:
        """The faces with the largest errors over 68 points, those not found first."""
        return sorted(self.results, key=lambda result: -result.error())[:n]

    def best(self, n: int) -> list[FaceResult]:
        """The faces with the smallest errors over 68 points."""
        found = [result for result in self.results if result.failure is None]
        return sorted(found, key=lambda result: result.error())[:n]

    def errors(self, points: str = "68", method: str | None = None) -> Float64[ndarray, " n"]:
        """The error of each face, a fraction."""
        return _errors(_landmark_errors(self.results, method), points)

    def mean_of_landmarks(self, method: str | None = None) -> Float64[ndarray, "68"]:
        """The error of each landmark, mean over the faces that were found; NaN where none was."""
        errors = _landmark_errors(self.results, method)
        found = errors[np.isfinite(errors).all(axis=1)]
        return found.mean(axis=0) if len(found) else np.full(68, np.nan)

    def mean_of_parts(self, method: str | None = None) -> dict[str, float]:
        """The error of each part of the face, mean over its landmarks and the faces that were found."""
        means = self.mean_of_landmarks(method)
        return {part: float(means[list(indices)].mean()) for part, indices in IBUG68_PARTS.items()}


def make_report(
    manifest: Manifest,
    settings: EvaluationSettings,
    subject: dict[str, Any],
    results: Sequence[FaceResult],
    missing: Sequence[str] = (),
    unreadable: Sequence[Unreadable] = (),
) -> Report:
    """Sums up the results of a benchmark."""
    groups = YAW_BINS if manifest.groups == "yaw" else tuple(part.name for part in manifest.parts)
    table = _Table(manifest, groups, [result.group for result in results], cluster_names(results), settings.bootstrap)
    methods = (settings.method, BASELINE)
    errors = {method: _landmark_errors(results, method) for method in methods}
    errors_by_name = {result.name: result.error() for result in results}
    return Report(
        manifest=manifest,
        settings=settings,
        subject=subject,
        rows=table.rows(errors),
        rows3d=_rows3d(table, manifest, results, settings),
        by=tuple(
            errors_by_attribute(own, errors_by_name, manifest.threshold, settings.bootstrap) for own in settings.by
        ),
        poses=summarise_poses([own.yaw_deg for own in results], [own.pose_errors_deg for own in results]),
        detection=summarise_detections([own.detection for own in results], [own.yaw_deg for own in results]),
        maps=mean_errors([result.maps for result in results]),
        coefficients=mean_errors([result.coefficients for result in results]),
        results=tuple(results),
        missing=tuple(missing),
        unreadable=tuple(unreadable),
    )


def cluster_names(results: Sequence[FaceResult]) -> list[str]:
    """The cluster of each face in the bootstrap: the clip of a frame, else the face itself."""
    return [result.name if result.clip is None else result.clip for result in results]


@final
@dataclass(frozen=True)
class _Table:
    """What all rows of a table share."""

    manifest: Manifest
    groups: Sequence[str]
    group_of_face: Sequence[str]
    clusters: Sequence[str]
    bootstrap: Bootstrap

    def rows(self, errors: Mapping[str, Float64[ndarray, "n 68"]]) -> tuple[ReportRow, ...]:
        """A row for each method and point set; the last method is the baseline."""
        baseline = list(errors.values())[-1]
        return tuple(
            self._row(method, points, _errors(own, points), _errors(baseline, points))
            for method, own in errors.items()
            for points in POINT_SETS
        )

    def _row(
        self, method: str, points: str, errors: Float64[ndarray, " n"], baseline: Float64[ndarray, " n"]
    ) -> ReportRow:
        threshold = self.manifest.threshold
        group_of_face = np.asarray(self.group_of_face, dtype=np.str_)
        is_in = {group: group_of_face == group for group in self.groups}
        summaries = {group: summarise(errors[chosen], threshold) for group, chosen in is_in.items()}
        known = [summary.mean for summary in summaries.values() if summary.mean is not None]
        is_binned = self.manifest.groups == "yaw" and len(known) == len(summaries)
        statistics = _statistics(errors, threshold, is_in, is_binned=is_binned)
        with_baseline = np.where(np.isfinite(errors), errors, baseline)
        return ReportRow(
            method=method,
            points=points,
            groups=summaries,
            mean_of_groups=float(np.mean(known)) if is_binned else None,
            all_images=summarise(errors, threshold),
            mean_failures_as_baseline=float(with_baseline.mean()) if len(errors) else None,
            intervals=intervals(statistics, cluster_indices(self.clusters), self.bootstrap),
        )


def _statistics(
    errors: Float64[ndarray, " n"], threshold: float, is_in: Mapping[str, ndarray], *, is_binned: bool
) -> dict[str, Statistic]:
    means = {group: mean_of(np.where(chosen, errors, np.inf)) for group, chosen in is_in.items()}
    statistics: dict[str, Statistic] = dict(means)
    if is_binned:
        statistics["mean_of_groups"] = mean_of_statistics(list(means.values()))
    statistics["mean"] = mean_of(errors)
    statistics["median"] = median_of(errors)
    statistics["area_under_curve"] = mean_of(np.clip(1 - errors / threshold, 0, None))
    statistics["failure_rate"] = mean_of((errors > threshold).astype(np.float64))
    return statistics


def _rows3d(
    table: _Table, manifest: Manifest, results: Sequence[FaceResult], settings: EvaluationSettings
) -> tuple[ReportRow, ...]:
    known = [result for result in results if result.distances3d is not None]
    if manifest.threshold3d is None or not any(result.failure is None for result in known):
        return ()
    in_space = replace(
        table,
        manifest=replace(manifest, threshold=manifest.threshold3d),
        group_of_face=[result.group for result in known],
        clusters=cluster_names(known),
    )
    found, baseline = (
        np.stack([distances for distances in column if distances is not None])
        for column in ([r.distances3d for r in known], [r.baseline_distances3d for r in known])
    )
    return in_space.rows({settings.method: found, BASELINE: baseline})


def _landmark_errors(results: Sequence[FaceResult], method: str | None) -> Float64[ndarray, "n 68"]:
    chosen = [result.baseline_errors if method == BASELINE else result.landmark_errors for result in results]
    return np.array(chosen, dtype=np.float64).reshape(-1, 68)


def _errors(landmark_errors: Float64[ndarray, "n 68"], points: str) -> Float64[ndarray, " n"]:
    return landmark_errors[:, list(POINT_SETS[points])].mean(axis=1)
