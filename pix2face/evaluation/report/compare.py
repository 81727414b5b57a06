"""Compares two evaluations of the same benchmark face by face: which is better, and whether that may be chance."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.evaluation.figures.bootstrap import (
    Bootstrap,
    Interval,
    Statistic,
    cluster_indices,
    intervals,
    mean_of,
)
from pix2face.evaluation.report.report_files import FORMAT, SCHEMA_VERSION
from pix2face.files.json_text import JsonObject, read_json_file, typed
from pix2face.geometry.landmark_metrics import POINT_SETS

# What must be the same in both for their errors to mean the same.
SAME = ("split", "truth", "normaliser", "threshold")
# 300-VW, the largest benchmark, makes less.
LARGEST_BYTES = 128 << 20
LARGEST_ERROR = 1e9


@dataclass(frozen=True, slots=True)
class _Face:
    name: str
    clip: str | None
    errors: dict[str, float | None]


@dataclass(frozen=True, slots=True)
class _Content:
    """What is read of a report."""

    method: str
    benchmark: JsonObject
    subject: JsonObject
    faces: list[_Face]


@final
@dataclass(frozen=True, eq=False)
class StoredReport:
    """The part of a ``report.json`` that a comparison needs."""

    path: Path
    benchmark: Mapping[str, Any]  # split, truth, normaliser, threshold and more
    method: str  # what was measured
    errors: Mapping[str, Mapping[str, float]]  # by point set and face; infinity for a face that was not found
    clips: Mapping[str, str]  # the clip of each face, or its own name
    landmarks: str  # which landmarks were measured, in words


@final
@dataclass(frozen=True)
class PointComparison:
    """B against A over one point set; differences are B minus A, so that below 0 B is better (not so for the area)."""

    n_both_found: int  # faces that both found; the means are over them
    mean_a: float | None  # mean error, a fraction
    mean_b: float | None
    difference: float | None  # of the means
    share_b_better: float  # of all common faces, those with a smaller error in B, with those that only B found
    share_a_better: float  # likewise for A; the rest are ties
    difference_of_area: float  # of the areas under the curve, over all common faces
    difference_of_failure_rate: float  # over all common faces
    intervals: dict[str, Interval | None]  # 95 % intervals of the three differences, by name


@final
@dataclass(frozen=True)
class Comparison:
    """Two reports side by side."""

    n_common: int  # faces in both; everything below is over these
    only_a: tuple[str, ...]  # names of faces that A alone has
    only_b: tuple[str, ...]  # names of faces that B alone has
    n_drawn: int  # how many images (or clips) a resample consists of
    points: dict[str, PointComparison]  # the figures of each point set


def read_report(path: Path) -> StoredReport:
    """Reads what ``evaluate`` wrote.

    Raises:
        InputFileError: It cannot be read, is no JSON, no report, of another schema, or lacks something.
    """
    content = read_json_file(path, JsonObject, "a report.json of evaluate", LARGEST_BYTES)
    if content.get("format") != FORMAT:
        raise InputFileError(f"{path}: expected a report.json of evaluate, found other JSON; evaluate again")
    if content.get("schema_version") != SCHEMA_VERSION:
        raise InputFileError(
            f"{path}: expected schema {SCHEMA_VERSION}, found {content.get('schema_version')!r}; evaluate again"
        )
    try:
        return _stored_report(path, typed(content, _Content))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputFileError(
            f"{path}: expected a complete report.json of evaluate, found it damaged: {error}"
        ) from error


def compare_reports(a: StoredReport, b: StoredReport, bootstrap: Bootstrap) -> Comparison:
    """Compares two evaluations over the faces that both have, by a paired bootstrap.

    Each draw takes the same faces (of video: the same clips) from both, so that the difficulty of a face cancels.

    Raises:
        UsageError: They are of different splits, truths, normalisers or thresholds, or have no face in common.
    """
    for key in SAME:
        if a.benchmark.get(key) != b.benchmark.get(key):
            raise UsageError(
                f"expected two reports of the same {key}, found {a.benchmark.get(key)!r} in {a.path} and "
                f"{b.benchmark.get(key)!r} in {b.path}: their errors do not mean the same"
            )
    common = [name for name in a.clips if name in b.clips]
    if not common:
        raise UsageError(f"expected reports with faces in common, found none in {a.path} and {b.path}")
    clusters = cluster_indices([a.clips[name] for name in common])
    threshold = float(a.benchmark["threshold"])
    points = {}
    for name in POINT_SETS:
        own, other = (np.array([report.errors[name][face] for face in common]) for report in (a, b))
        points[name] = _compare(own, other, threshold, clusters, bootstrap)
    return Comparison(
        n_common=len(common),
        only_a=tuple(name for name in a.clips if name not in b.clips),
        only_b=tuple(name for name in b.clips if name not in a.clips),
        n_drawn=int(clusters.max()) + 1,
        points=points,
    )


def _stored_report(path: Path, content: _Content) -> StoredReport:
    faces = content.faces
    names = [face.name for face in faces]
    if len(set(names)) < len(names):
        raise ValueError("a face is in it twice")
    errors = {
        points: {name: _error(face.errors[points]) for name, face in zip(names, faces, strict=True)}
        for points in POINT_SETS
    }
    benchmark = {key: content.benchmark[key] for key in (*SAME, "box_rule", "title")}
    if not 0 < float(benchmark["threshold"]) < np.inf:
        raise ValueError(f"a threshold of {benchmark['threshold']}")
    clips = {name: face.clip or name for name, face in zip(names, faces, strict=True)}
    return StoredReport(
        path, benchmark, content.method, errors, clips, str(content.subject.get("landmarks", "not stated"))
    )


def _error(value: float | None) -> float:
    if value is None:
        return float("inf")
    if not 0 <= value <= LARGEST_ERROR:
        raise ValueError(f"an error of {value}")
    return float(value)


def _compare(
    a: Float64[ndarray, " n"], b: Float64[ndarray, " n"], threshold: float, clusters: ndarray, bootstrap: Bootstrap
) -> PointComparison:
    both: Bool[ndarray, " n"] = np.isfinite(a) & np.isfinite(b)
    difference = np.full(len(a), np.inf)
    difference[both] = b[both] - a[both]
    area = np.clip(1 - b / threshold, 0, None) - np.clip(1 - a / threshold, 0, None)
    failures = (b > threshold).astype(np.float64) - (a > threshold)
    statistics: dict[str, Statistic] = {
        "difference": mean_of(difference),
        "difference_of_area": mean_of(area),
        "difference_of_failure_rate": mean_of(failures),
    }
    n_both = int(both.sum())
    return PointComparison(
        n_both_found=n_both,
        mean_a=float(a[both].mean()) if n_both else None,
        mean_b=float(b[both].mean()) if n_both else None,
        difference=float(difference[both].mean()) if n_both else None,
        share_b_better=float((b < a).mean()),
        share_a_better=float((a < b).mean()),
        difference_of_area=float(area.mean()),
        difference_of_failure_rate=float(failures.mean()),
        intervals=intervals(statistics, clusters, bootstrap),
    )
