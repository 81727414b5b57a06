"""The pinhole camera from 3D-2D correspondences, by Levenberg-Marquardt."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.cameras.camera_fit import FLATNESS, STEPS_A_WEIGHING, check_points
from pix2face.fitting.least_squares.levenberg_marquardt import (
    MAX_ITERATIONS,
    LocalQuadratic,
    minimise,
    quadratic_of_residuals,
)
from pix2face.fitting.least_squares.robust import reweighted
from pix2face.fitting.least_squares.similarity import rotated, rotation_jacobian
from pix2face.geometry.camera import Camera, Pinhole, nearest_weak_perspective, pinhole_camera

# A face that far away shows no perspective: 0.1 % of what 1 m shows. Farther is not told apart.
FARTHEST_MM = 1e6
LEAST_POINTS = 6


@final
@dataclass(frozen=True, eq=False)
class PinholeState:
    """A pinhole about the centre of the points: pixel = principal point + (scale R x + shift) / (1 + inverse z)."""

    log_scale: float  # logarithm of f / distance, pixels per mm at the centre of the points
    rotation: Float64[ndarray, "3 3"]  # camera_from_model
    shift_px: Float64[ndarray, "2"]  # image of the centre of the points, relative to the principal point
    inverse_distance: float  # of the centre along the optical axis, 1/mm; z is that of R x

    def apply(self, points3d: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 2"]:
        """Images (pixels, relative to the principal point) of points (mm, relative to their centre).

        Infinitely far off where a point is behind the camera.
        """
        turned = points3d @ self.rotation.T
        denominator = 1 + self.inverse_distance * turned[:, 2:]
        image = (np.exp(self.log_scale) * turned[:, :2] + self.shift_px) / np.where(denominator > 0, denominator, 1)
        return np.where(denominator > 0, image, np.inf)

    def moved(self, step: Float64[ndarray, "7"]) -> "PinholeState":
        """The state after an increment (log scale, rotation vector, shift, inverse distance)."""
        return PinholeState(
            self.log_scale + float(step[0]),
            rotated(self.rotation, step[1:4]),
            self.shift_px + step[4:6],
            self.inverse_distance + float(step[6]),
        )


def fit_pinhole_camera(
    points3d: Float[ndarray, "n 3"],
    points2d: Float[ndarray, "n 2"],
    principal_point_px: Float[ndarray, "2"],
    initial: Camera,
    *,
    robust: bool = False,
) -> Camera:
    """Fits focal length, rotation and translation by minimising the reprojection error, from an affine camera.

    Points and ``robust`` are those of ``fit_affine_camera``; pixels are square and without skew. Points without
    perspective (or with the reverse of it) get a camera at a distance of 1 km.

    Raises:
        DegenerateGeometryError: Fewer than 6 points, all in one plane or line, or some not finite.

    Source: Crispell and Bazik 2017, Section 3.4.1.

    Deviation from the paper: it starts at a fixed, very large focal length f and moves f, R and T. Here the same camera
    is written with f / distance and 1 / distance, and starts at 1 / distance = 0, an infinite f. f and T_z nearly
    cancel, so steps in them are badly conditioned, while these unknowns are nearly independent.
    """
    _check(points3d, points2d)
    origin = np.asarray(points3d.mean(axis=0), dtype=np.float64)
    centred = points3d.astype(np.float64) - origin
    relative = points2d.astype(np.float64) - principal_point_px
    nearest = nearest_weak_perspective(initial)
    shift = np.asarray(initial.project(origin) - principal_point_px, dtype=np.float64)
    start = PinholeState(float(np.log(nearest.scale)), nearest.rotation, shift, 0.0)
    state = _fit(start, centred, relative, has_perspective=True, robust=robust)
    if state.inverse_distance < 1 / FARTHEST_MM:
        start = PinholeState(start.log_scale, start.rotation, start.shift_px, 1 / FARTHEST_MM)
        state = _fit(start, centred, relative, has_perspective=False, robust=robust)
    return _camera(state, origin, np.asarray(principal_point_px, dtype=np.float64))


def _check(points3d: Float[ndarray, "n 3"], points2d: Float[ndarray, "n 2"]) -> None:
    check_points(points3d, points2d, at_least=LEAST_POINTS)
    spread = np.linalg.eigvalsh(np.cov(points3d.astype(np.float64).T))
    if not spread[0] > FLATNESS**2 * spread[2]:
        raise DegenerateGeometryError("a pinhole camera needs points in space, found all in one plane or line")


def _fit(
    start: PinholeState,
    points3d: Float64[ndarray, "n 3"],
    points2d: Float64[ndarray, "n 2"],
    *,
    has_perspective: bool,
    robust: bool,
) -> PinholeState:
    def solve(state: PinholeState, weights: Float64[ndarray, " n"], max_iterations: int) -> PinholeState:
        def local_quadratic(state: PinholeState) -> LocalQuadratic:
            residuals, jacobian = linearised_pinhole(state, points3d, points2d)
            if not has_perspective:
                jacobian[:, :, 6] = 0  # holds the distance
            return quadratic_of_residuals(residuals, jacobian, weights)

        return minimise(state, local_quadratic, PinholeState.moved, max_iterations=max_iterations)[0]

    def distances(state: PinholeState) -> Float64[ndarray, " n"]:
        return np.sqrt(((state.apply(points3d) - points2d) ** 2).sum(axis=1))

    weights = np.full(len(points3d), 1.0)
    plain = solve(start, weights, MAX_ITERATIONS)
    if not robust:
        return plain
    return reweighted(plain, distances, lambda state, own: solve(state, own, STEPS_A_WEIGHING), weights)


def linearised_pinhole(
    state: PinholeState, points3d: Float64[ndarray, "n 3"], points2d: Float64[ndarray, "n 2"]
) -> tuple[Float64[ndarray, "n 2"], Float64[ndarray, "n 2 7"]]:
    """Residuals in pixels and their derivatives with respect to an increment, as ``PinholeState.moved`` takes it.

    Points are in mm, relative to their centre; their images in pixels, relative to the principal point.
    """
    turned = points3d @ state.rotation.T
    derivative = rotation_jacobian(turned)
    scaled = np.exp(state.log_scale) * turned[:, :2]
    denominator = 1 + state.inverse_distance * turned[:, 2]
    # A point behind the camera has no image: refuse the step that led there.
    inverse = np.where(denominator > 0, 1 / np.where(denominator == 0, 1, denominator), np.nan)
    image = (scaled + state.shift_px) * inverse[:, None]
    jacobian = np.empty((len(points3d), 2, 7))
    jacobian[:, :, 0] = scaled
    jacobian[:, :, 1:4] = np.exp(state.log_scale) * derivative[:, :2]
    jacobian[:, :, 1:4] -= state.inverse_distance * image[:, :, None] * derivative[:, None, 2]
    jacobian[:, :, 4:6] = np.eye(2)
    jacobian[:, :, 6] = -image * turned[:, 2:]
    jacobian *= inverse[:, None, None]
    return image - points2d, jacobian


def _camera(state: PinholeState, origin: Float64[ndarray, "3"], principal_point_px: Float64[ndarray, "2"]) -> Camera:
    distance, scale = 1 / state.inverse_distance, float(np.exp(state.log_scale))
    centre = np.append(state.shift_px / scale, distance)  # the points' centre in camera space
    translation = centre - state.rotation @ origin
    return pinhole_camera(Pinhole(scale * distance, principal_point_px, state.rotation, translation))
