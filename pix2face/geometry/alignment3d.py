"""How 3D landmarks are laid onto the true ones before their distances are measured; results without this say little."""

from typing import Literal

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.rigid_alignment import fit_rigid

# As they are; moved and turned; moved, turned and scaled.
Alignment = Literal["none", "rigid", "similarity"]
ALIGNMENTS: dict[Alignment, str] = {
    "none": "as they are: same unit, axes and origin needed",
    "rigid": "moved and turned by least squares over all points, not scaled: same unit needed",
    "similarity": "moved, turned and scaled by least squares over all points",
}


def aligned(
    points: Float[ndarray, "n 3"], truth: Float[ndarray, "n 3"], alignment: Alignment
) -> Float64[ndarray, "n 3"]:
    """Points laid onto true ones.

    Raises:
        DegenerateGeometryError: Fewer than 3 points, all on one line, or not finite.

    Source: Umeyama 1991, Least-squares estimation of transformation parameters between two point patterns.
    """
    if not (np.isfinite(points).all() and np.isfinite(truth).all()):
        raise DegenerateGeometryError("expected finite 3D landmarks, found NaN or infinity")
    if alignment == "none":
        return points.astype(np.float64)
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
