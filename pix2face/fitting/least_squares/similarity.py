"""Scaled rotation and shift: y = scale * (rotation @ x) + shift, of which an image shows the first two coordinates.

This is the weak-perspective camera with pixels as the unit; with three rows (depth known as well) it is a similarity.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.geometry.camera import Camera, WeakPerspective, weak_perspective_camera

# Increments: log scale, rotation vector (camera frame), then the shift.
N_ROTATION_AND_SCALE = 4


@final
@dataclass(frozen=True, eq=False)
class Similarity:
    """Scale, rotation and shift (pixels)."""

    log_scale: float  # logarithm of pixels per mm
    rotation: Float64[ndarray, "3 3"]  # camera_from_model
    # Image of the point that the fit takes as origin; the third of 3 coordinates is depth.
    shift_px: Float64[ndarray, " d"]

    @property
    def scale(self) -> float:
        """Pixels per mm."""
        return float(np.exp(self.log_scale))

    @cached_property
    def matrix(self) -> Float64[ndarray, "2 4"]:
        """The linear map from (x, 1) to the image."""
        return np.column_stack([self.scale * self.rotation[:2], self.shift_px[:2]])

    @cached_property
    def derivative(self) -> Float64[ndarray, "6 2 4"]:
        """Derivative of ``matrix`` with respect to (log scale, rotation increment, shift)."""
        x, y, z = self.scale * self.rotation
        out = np.zeros((6, 2, 4))
        out[0, 0, :3], out[0, 1, :3] = x, y
        out[1, 1, :3], out[2, 0, :3] = -z, z
        out[3, 0, :3], out[3, 1, :3] = -y, x
        out[4, 0, 3] = out[5, 1, 3] = 1
        return out

    def apply(self, points: Float[ndarray, "n 3"]) -> Float64[ndarray, "n d"]:
        """Points (mm, relative to the fit's origin) to pixels."""
        rows = self.scale * self.rotation[: len(self.shift_px)]
        return np.asarray(points @ rows.T + self.shift_px, dtype=np.float64)

    def jacobian(self, points: Float[ndarray, "n 3"]) -> Float64[ndarray, "n d 4+d"]:
        """Derivative of ``apply`` with respect to (log scale, rotation increment, shift)."""
        d = len(self.shift_px)
        turned = self.scale * (points @ self.rotation.T)
        out = np.zeros((len(points), d, N_ROTATION_AND_SCALE + d))
        out[:, :, 0] = turned[:, :d]
        out[:, :, 1:4] = rotation_jacobian(turned)[:, :d]
        out[:, np.arange(d), N_ROTATION_AND_SCALE + np.arange(d)] = 1
        return out

    def moved(self, step: Float64[ndarray, " p"]) -> "Similarity":
        """The similarity after an increment (log scale, rotation vector, shift); further entries are ignored."""
        end = N_ROTATION_AND_SCALE + len(self.shift_px)
        rotation = rotated(self.rotation, step[1:4])
        return Similarity(self.log_scale + float(step[0]), rotation, self.shift_px + step[N_ROTATION_AND_SCALE:end])

    def shifted(self, by_px: Float64[ndarray, " d"]) -> "Similarity":
        """The similarity of an image whose origin lies elsewhere."""
        return Similarity(self.log_scale, self.rotation, self.shift_px + by_px)

    def camera(self, origin: Float[ndarray, "3"]) -> Camera:
        """The weak-perspective camera, given the model point (mm) that the fit took as its origin."""
        translation = self.shift_px[:2] - self.scale * (self.rotation[:2] @ origin)
        return weak_perspective_camera(WeakPerspective(self.scale, self.rotation, translation))


def rotation_jacobian(turned: Float[ndarray, "n 3"]) -> Float64[ndarray, "n 3 3"]:
    """Derivative of exp([w]x) y with respect to w at 0: the matrix of -[y]x for each y."""
    out = np.zeros((len(turned), 3, 3))
    x, y, z = turned.T
    out[:, 0, 1], out[:, 0, 2] = z, -y
    out[:, 1, 0], out[:, 1, 2] = -z, x
    out[:, 2, 0], out[:, 2, 1] = y, -x
    return out


def rotated(rotation: Float64[ndarray, "3 3"], increment: Float64[ndarray, "3"]) -> Float64[ndarray, "3 3"]:
    """exp([increment]x) @ rotation."""
    from scipy.spatial.transform import Rotation  # a sixth of a second, which commands that fit nothing save

    return np.asarray(Rotation.from_rotvec(increment).as_matrix() @ rotation, dtype=np.float64)
