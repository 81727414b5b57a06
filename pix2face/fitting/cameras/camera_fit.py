"""Affine and weak-perspective cameras from 3D-2D correspondences."""

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.least_squares.levenberg_marquardt import minimise
from pix2face.fitting.least_squares.moments import Moments, stacked
from pix2face.fitting.least_squares.robust import lengths, reweighted
from pix2face.fitting.least_squares.similarity import Similarity
from pix2face.geometry.camera import Camera, HeadPose, affine_camera, nearest_weak_perspective, rotation_of_pose

# Spread along the thinnest direction over spread along the longest, below which points count as flat (or in line).
FLATNESS = 1e-5
# Steps of Levenberg-Marquardt between two weighings.
STEPS_A_WEIGHING = 3

# Where the points are too flat for an affine start, weak perspective tries the frontal face turned by these yaws.
YAW_STARTS_DEG = (-80.0, -40.0, 0.0, 40.0, 80.0)


def fit_affine_camera(
    points3d: Float[ndarray, "n 3"], points2d: Float[ndarray, "n 2"], *, robust: bool = False
) -> Camera:
    """Fits an affine camera to model points (mm) and their images (pixels) by linear least squares.

    A ``robust`` fit solves again with smaller weights for the points that disagree (``robust.reweighted``).

    Raises:
        DegenerateGeometryError: Fewer than 4 points, all in one plane, or some not finite.

    Source: Crispell and Bazik 2017, Eq. 1; Hartley and Zisserman, Algorithm 7.2 (here with normal equations: after
    centring, they are well conditioned).
    """
    check_points(points3d, points2d, at_least=4)
    points3d, points2d = points3d.astype(np.float64), points2d.astype(np.float64)
    start = _affine_rows_of_space(points3d, points2d, np.ones(len(points3d)))
    if not robust:
        return affine_camera(start)
    found = reweighted(
        start,
        lambda rows: lengths(points3d @ rows[:, :3].T + rows[:, 3] - points2d),
        lambda _, weights: _affine_rows_of_space(points3d, points2d, weights),
        np.ones(len(points3d)),
    )
    return affine_camera(found)


def fit_weak_perspective_camera(
    points3d: Float[ndarray, "n 3"],
    points2d: Float[ndarray, "n 2"],
    *,
    weights: Float[ndarray, " n"] | None = None,
    robust: bool = False,
) -> Camera:
    """Fits a weak-perspective camera (scaled orthography) by minimising the reprojection error.

    The start is the affine fit with its rows made orthogonal and equally long; from there Levenberg-Marquardt. Where
    the points are too flat for the affine fit, several yaws are tried and the best end is taken. Weights are factors of
    the squared residuals, 0 leaves a point out; ``robust`` is that of the affine fit.

    Raises:
        DegenerateGeometryError: Fewer than 4 points with a weight, all in one line, or some not finite.
    """
    weights = np.full(len(points3d), 1.0) if weights is None else weights.astype(np.float64)
    used = weights > 0
    points3d, points2d, weights = points3d[used].astype(np.float64), points2d[used].astype(np.float64), weights[used]
    check_points(points3d, points2d, at_least=4)
    origin = np.asarray(weights @ points3d / weights.sum(), dtype=np.float64)
    points3d = points3d - origin
    similarity = _best_similarity(points3d, points2d, weights)
    if robust:
        similarity = _robust_similarity(similarity, points3d, points2d, weights)
    return similarity.camera(origin)


def check_points(points3d: Float[ndarray, "n 3"], points2d: Float[ndarray, "n 2"], at_least: int) -> None:
    """Refuses too few points and points that are not finite.

    Raises:
        DegenerateGeometryError: See above.
    """
    if len(points3d) < at_least:
        raise DegenerateGeometryError(f"a camera needs at least {at_least} points, found {len(points3d)}")
    if not (np.isfinite(points3d).all() and np.isfinite(points2d).all()):
        raise DegenerateGeometryError("a camera needs finite points, found some that are not a number or infinite")


def _affine_rows_of_space(
    points3d: Float64[ndarray, "n 3"], points2d: Float64[ndarray, "n 2"], weights: Float64[ndarray, " n"]
) -> Float64[ndarray, "2 4"]:
    a = _affine_rows(points3d, points2d, weights)
    if a is None:
        raise DegenerateGeometryError(
            f"an affine camera needs points that are not in one plane, found {len(points3d)} flat ones"
        )
    return a


def _affine_rows(
    points3d: Float64[ndarray, "n 3"], points2d: Float64[ndarray, "n 2"], weights: Float64[ndarray, " n"]
) -> Float64[ndarray, "2 4"] | None:
    """The affine projection matrix, or None where the points are flat."""
    share = weights / weights.sum()
    centre3d, centre2d = share @ points3d, share @ points2d
    x, u = points3d - centre3d, points2d - centre2d
    scatter = (x * share[:, None]).T @ x
    spread = np.linalg.eigvalsh(scatter)
    if not spread[0] > FLATNESS**2 * spread[2]:
        return None
    # Eq. (1): p_0 x_i = u_i, p_1 x_i = v_i.
    linear = np.linalg.solve(scatter, (x * share[:, None]).T @ u).T
    return np.column_stack([linear, centre2d - linear @ centre3d])


def _best_similarity(
    points3d: Float64[ndarray, "n 3"],
    points2d: Float64[ndarray, "n 2"],
    weights: Float64[ndarray, " n"],
) -> Similarity:
    """The weak-perspective fit (points3d relative to their centre): the best end over the starts."""
    starts = _starts(points3d, points2d, weights)
    centre2d = np.asarray(weights @ points2d / weights.sum(), dtype=np.float64)
    local_quadratic = Moments.of(stacked(points3d, points2d - centre2d), weights).quadratic
    ends = [minimise(start.shifted(-centre2d), local_quadratic, Similarity.moved) for start in starts]
    return min(ends, key=lambda end: end[1].cost)[0].shifted(centre2d)


def _starts(
    points3d: Float64[ndarray, "n 3"],
    points2d: Float64[ndarray, "n 2"],
    weights: Float64[ndarray, " n"],
) -> list[Similarity]:
    centre2d = np.asarray(weights @ points2d / weights.sum(), dtype=np.float64)
    spread3d = float(np.sqrt(weights @ (points3d**2).sum(axis=1)))
    spread2d = float(np.sqrt(weights @ ((points2d - centre2d) ** 2).sum(axis=1)))
    spread = np.linalg.eigvalsh((points3d * weights[:, None]).T @ points3d)
    if not (spread[1] > FLATNESS**2 * spread[2] and spread2d > 0):
        raise DegenerateGeometryError(
            "a weak-perspective camera needs points that are neither in one line nor imaged to one place, "
            f"found {len(points3d)} that are"
        )
    log_scale = float(np.log(spread2d / spread3d * np.sqrt(1.5)))  # orthography keeps two of three axes
    affine = _affine_rows(points3d, points2d, weights)
    if affine is not None and np.linalg.svd(affine[:, :3], compute_uv=False)[1] > 0:
        nearest = nearest_weak_perspective(affine_camera(affine))
        return [Similarity(float(np.log(nearest.scale)), nearest.rotation, centre2d)]
    return [Similarity(log_scale, rotation_of_pose(HeadPose(0, yaw, 0)), centre2d) for yaw in YAW_STARTS_DEG]


def _robust_similarity(
    start: Similarity,
    points3d: Float64[ndarray, "n 3"],
    points2d: Float64[ndarray, "n 2"],
    weights: Float64[ndarray, " n"],
) -> Similarity:
    """Weighs the points by their residuals; between two weighings, the points are summed up once."""
    centre2d = np.asarray(weights @ points2d / weights.sum(), dtype=np.float64)
    centred2d = points2d - centre2d
    rows = stacked(points3d, centred2d)

    def solve(state: Similarity, robust_weights: Float64[ndarray, " n"]) -> Similarity:
        quadratic = Moments.of(rows, robust_weights).quadratic
        return minimise(state, quadratic, Similarity.moved, max_iterations=STEPS_A_WEIGHING)[0]

    found = reweighted(
        start.shifted(-centre2d),
        lambda state: lengths(state.apply(points3d) - centred2d),
        solve,
        weights,
    )
    return found.shifted(centre2d)
