"""When perspective is warranted: a pinhole where the picture tells the distance, weak perspective where it does not.

The rule has two parts, and a pinhole must pass both.

1. The distance is determined: the standard error of 1 / distance (to which that of the focal length is proportional) is
   at most 2.5 % of it, so that two standard errors are 5 %. Neighbouring residuals are alike, so it is the sandwich
   estimate over patches of the picture: what each patch pulls at the camera counts as one error.
2. It matters: the distance is at most ten widths of the face. Beyond, a camera without perspective displaces points by
   less than 0.4 % of the width of the face, below what networks and annotators agree on.
"""

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.fitting.cameras.camera_fit import fit_affine_camera, fit_weak_perspective_camera
from pix2face.fitting.cameras.pinhole_fit import FARTHEST_MM, PinholeState, fit_pinhole_camera, linearised_pinhole
from pix2face.fitting.least_squares.robust import huber_threshold, huber_weights
from pix2face.geometry.camera import Camera, pinhole_of

LARGEST_RELATIVE_ERROR = 0.025
FARTHEST_IN_WIDTHS = 10.0
# Patches of the picture along each axis, over the box of the points.
PATCHES_A_SIDE = 6


def fit_warranted_camera(
    points3d: Float[ndarray, "n 3"],
    points2d: Float[ndarray, "n 2"],
    principal_point_px: Float[ndarray, "2"],
    face_width_mm: float,
) -> Camera:
    """A pinhole where it is warranted, else weak perspective; both robust. The width is that of the points' face.

    Raises:
        DegenerateGeometryError: The points do not determine a camera.
    """
    initial = fit_affine_camera(points3d, points2d, robust=True)
    pinhole = fit_pinhole_camera(points3d, points2d, principal_point_px, initial, robust=True)
    distance_mm, relative_error = perspective_evidence(pinhole, points3d, points2d)
    if relative_error <= LARGEST_RELATIVE_ERROR and distance_mm <= FARTHEST_IN_WIDTHS * face_width_mm:
        return pinhole
    return fit_weak_perspective_camera(points3d, points2d, robust=True)


def perspective_evidence(
    pinhole: Camera, points3d: Float[ndarray, "n 3"], points2d: Float[ndarray, "n 2"]
) -> tuple[float, float]:
    """What a pinhole that was fitted to points says: the distance, and the standard error of its inverse.

    The distance (mm) is that of the points' centre along the optical axis; the error is relative.

    Source: Liang and Zeger 1986, for the sandwich estimate over groups.
    """
    fitted = pinhole_of(pinhole)
    origin = np.asarray(points3d.mean(axis=0), dtype=np.float64)
    centre = fitted.rotation @ origin + fitted.translation_mm
    scale, inverse_distance = fitted.focal_px / float(centre[2]), 1 / float(centre[2])
    state = PinholeState(float(np.log(scale)), fitted.rotation, scale * centre[:2], inverse_distance)
    if centre[2] > FARTHEST_MM / 2:
        return float(centre[2]), np.inf
    relative = points2d.astype(np.float64) - fitted.principal_point_px
    residuals, jacobian = linearised_pinhole(state, points3d.astype(np.float64) - origin, relative)
    lengths = np.sqrt((residuals**2).sum(axis=1))
    weights = huber_weights(lengths, huber_threshold(lengths)) ** 2
    error = _standard_errors(residuals, jacobian, weights, _patches(relative))[6]
    return float(centre[2]), float(error * centre[2])


def _standard_errors(
    residuals: Float64[ndarray, "n 2"],
    jacobian: Float64[ndarray, "n 2 p"],
    weights: Float64[ndarray, " n"],
    patches: Float64[ndarray, "n g"],
) -> Float64[ndarray, " p"]:
    """Standard error of each unknown, with errors that are alike within groups (columns of 0 and 1)."""
    weighted = jacobian * weights[:, None, None]
    hessian = np.einsum("nap,naq->pq", weighted, jacobian)
    pull = patches.T @ np.einsum("nap,na->np", weighted, residuals)
    inverse = np.linalg.inv(hessian)
    # Residuals are smaller than errors, since the fit has followed them: the usual factor for few groups.
    n_groups = int((patches.sum(axis=0) > 0).sum())
    followed = n_groups / max(n_groups - len(hessian), 1)
    covariance = followed * inverse @ (pull.T @ pull) @ inverse
    return np.sqrt(np.diagonal(covariance))


def _patches(points2d: Float64[ndarray, "n 2"]) -> Float64[ndarray, "n g"]:
    low, high = points2d.min(axis=0), points2d.max(axis=0)
    cell = np.minimum((points2d - low) / np.maximum(high - low, 1e-9) * PATCHES_A_SIDE, PATCHES_A_SIDE - 1).astype(int)
    number = cell[:, 0] * PATCHES_A_SIDE + cell[:, 1]
    return np.eye(PATCHES_A_SIDE**2)[number]
