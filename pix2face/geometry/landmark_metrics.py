"""Errors of landmarks: normalised mean error, error curve, area under it, failure rate.

A face whose fit failed has an infinite error. It is part of every count: the curve never reaches it, and the failure
rate includes it. Only means and medians are over the other faces; ``n_failed`` says how many failed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.geometry import Alignment, Normaliser
from pix2face.geometry.landmarks import INNER51, LEFT_EYE, OUTER_EYE_CORNERS, RIGHT_EYE
from pix2face.geometry.rigid_alignment import fit_rigid

ALIGNMENTS: dict[Alignment, str] = {
    "none": "as they are: same unit, axes and origin needed",
    "rigid": "moved and turned by least squares over all points, not scaled: same unit needed",
    "similarity": "moved, turned and scaled by least squares over all points",
    "depth": "as they are in the picture, z (towards the viewer, in pixels) moved by its mean over all points",
}

ALL68 = tuple(range(68))
POINT_SETS = {"68": ALL68, "51": INNER51}


@final
@dataclass(frozen=True)
class ErrorSummary:
    """Summary of the errors of a set of faces, in fractions (not per cent); None if there is nothing to average."""

    n_images: int  #: faces evaluated, failed ones included
    n_failed: int  #: faces without a fit (error infinity)
    mean: float | None  #: over the successes
    median: float | None  #: over the successes
    area_under_curve: float | None  #: over all faces, from 0 to the threshold; 1 is perfect
    failure_rate: float | None  #: fraction of all faces with an error above the threshold


def normalising_distance(truth: Float[ndarray, "68 2"], normaliser: Normaliser) -> float:
    """The length in pixels that errors are divided by, from the true landmarks.

    ``outer-eye``: distance of the outer eye corners. ``inter-pupil``: distance of the means of each eye's six points.
    ``box-sqrt``: sqrt(w h) of the tight box of all points. ``box-diagonal``: its diagonal.

    Raises:
        DegenerateGeometryError: The length is zero or not finite.
    """
    width, height = np.ptp(truth, axis=0)
    lengths = {
        "outer-eye": np.linalg.norm(truth[OUTER_EYE_CORNERS[1]] - truth[OUTER_EYE_CORNERS[0]]),
        "inter-pupil": np.linalg.norm(truth[list(LEFT_EYE)].mean(axis=0) - truth[list(RIGHT_EYE)].mean(axis=0)),
        "box-sqrt": np.sqrt(width * height),
        "box-diagonal": np.hypot(width, height),
    }
    length = float(lengths[normaliser])
    if not (np.isfinite(length) and length > 0):
        raise DegenerateGeometryError(f"expected a positive length for the normaliser {normaliser}, found {length} px")
    return length


def landmark_errors(
    predicted: Float[ndarray, "68 2"], truth: Float[ndarray, "68 2"], normaliser: Normaliser
) -> Float64[ndarray, "68"]:
    """The distance of each landmark from its true place, divided by a length computed from all true landmarks.

    It is a fraction (0.03 is 3 %), and infinity for a predicted point that is not finite.

    Raises:
        DegenerateGeometryError: The normaliser is zero or not finite.
    """
    distances = np.linalg.norm(predicted.astype(np.float64) - truth, axis=1) / normalising_distance(truth, normaliser)
    return np.where(np.isfinite(distances), distances, np.inf)


def nme(
    predicted: Float[ndarray, "68 2"],
    truth: Float[ndarray, "68 2"],
    normaliser: Normaliser,
    points: Sequence[int] = ALL68,
) -> float:
    """Normalised mean error of one face: the mean of ``landmark_errors`` over some points.

    Raises:
        DegenerateGeometryError: The normaliser is zero or not finite.
    """
    return float(landmark_errors(predicted, truth, normaliser)[list(points)].mean())


def error_curve(errors: Float[ndarray, " n"], threshold: float, n: int = 201) -> Float64[ndarray, "steps 2"]:
    """The cumulative error distribution: rows of (error from 0 to the threshold, fraction of all faces up to it)."""
    steps = np.linspace(0, threshold, n)
    counts = np.searchsorted(np.sort(errors), steps, side="right")
    return np.column_stack([steps, counts / max(len(errors), 1)])


def area_under_curve(errors: Float[ndarray, " n"], threshold: float) -> float:
    """Area under the error curve from 0 to a threshold, divided by the threshold; exact, without steps.

    A face of error e contributes a step of height 1/n from e on, so the area is the mean of max(0, 1 - e / threshold).
    """
    return float(np.clip(1 - errors / threshold, 0, None).mean())


def failure_rate(errors: Float[ndarray, " n"], threshold: float) -> float:
    """Fraction of faces with an error above a threshold."""
    return float((errors > threshold).mean())


def summarise(errors: Float[ndarray, " n"], threshold: float) -> ErrorSummary:
    """Summarises the errors of a set of faces."""
    fitted = errors[np.isfinite(errors)]
    return ErrorSummary(
        n_images=len(errors),
        n_failed=len(errors) - len(fitted),
        mean=float(fitted.mean()) if len(fitted) else None,
        median=float(np.median(fitted)) if len(fitted) else None,
        area_under_curve=area_under_curve(errors, threshold) if len(errors) else None,
        failure_rate=failure_rate(errors, threshold) if len(errors) else None,
    )


def aligned(
    points: Float[ndarray, "n 3"], truth: Float[ndarray, "n 3"], alignment: Alignment
) -> Float64[ndarray, "n 3"]:
    """Aligns points with the true ones.

    Raises:
        DegenerateGeometryError: Fewer than 3 points, all on one line, or not finite.

    Source: Umeyama 1991, Least-squares estimation of transformation parameters between two point patterns.
    """
    if not (np.isfinite(points).all() and np.isfinite(truth).all()):
        raise DegenerateGeometryError("expected finite 3D landmarks, found NaN or infinity")
    if alignment == "none":
        return points.astype(np.float64)
    if alignment == "depth":
        return points + [0, 0, np.mean(truth[:, 2] - points[:, 2])]
    rigid, scale = fit_rigid(points, truth)
    if alignment == "rigid":
        return rigid.apply(points)
    # Of a similarity the rotation is the same; the scale is taken about the centres, which lie on each other.
    centre = truth.mean(axis=0, dtype=np.float64)
    return np.asarray(centre + scale * (rigid.apply(points) - centre), dtype=np.float64)


def distances3d(
    points: Float[ndarray, "n 3"], truth: Float[ndarray, "n 3"], alignment: Alignment
) -> Float64[ndarray, " n"]:
    """The distance of each point from its true place after alignment, in the unit of the truth.

    Raises:
        DegenerateGeometryError: The points cannot be aligned.
    """
    return np.asarray(np.linalg.norm(aligned(points, truth, alignment) - truth, axis=1), dtype=np.float64)
