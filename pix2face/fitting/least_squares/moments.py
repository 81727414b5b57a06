"""Weak perspective from moments: with the points summed up once, each step of the fit costs the same for any number.

The residuals of a camera without perspective are linear in its 2 x 4 matrix M, so their weighted sum of squares is
tr(M S M^T) - 2 tr(M C^T) + w with three sums over the points.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.fitting.least_squares.levenberg_marquardt import LocalQuadratic
from pix2face.fitting.least_squares.similarity import Similarity


@final
@dataclass(frozen=True, eq=False)
class Moments:
    """Weighted sums over 3D-2D correspondences, y = (x, 1) and u."""

    s: Float64[ndarray, "4 4"]  # sum of y y^T
    c: Float64[ndarray, "2 4"]  # sum of u y^T
    w: float  # sum of |u|^2

    @classmethod
    def of(
        cls, points3d: Float64[ndarray, "n 3"], points2d: Float64[ndarray, "n 2"], weights: Float64[ndarray, " n"]
    ) -> "Moments":
        """Sums up. Both kinds of points should be near their centres, or digits are lost."""
        y = np.column_stack([points3d, np.ones(len(points3d))])
        weighted = y * weights[:, None]
        return cls(y.T @ weighted, points2d.T @ weighted, float(weights @ (points2d**2).sum(axis=1)))

    def quadratic(self) -> Callable[[Similarity], LocalQuadratic]:
        """The local quadratic of half the weighted sum of squares, as ``minimise`` takes it."""

        def local_quadratic(state: Similarity) -> LocalQuadratic:
            linear = state.scale * state.rotation
            matrix = np.column_stack([linear[:2], state.shift_px])
            # Rows: d M / d (log scale, rotation about x, y, z, shift), each 2 x 4.
            derivative = np.zeros((6, 2, 4))
            derivative[0, :, :3] = linear[:2]
            derivative[1, 1, :3], derivative[2, 0, :3] = -linear[2], linear[2]
            derivative[3, 0, :3], derivative[3, 1, :3] = -linear[1], linear[0]
            derivative[4, 0, 3] = derivative[5, 1, 3] = 1
            rows = derivative.reshape(6, 8)
            ms = matrix @ self.s
            cost = float(((ms - 2 * self.c) * matrix).sum() + self.w) / 2
            gradient = rows @ (ms - self.c).reshape(8)
            return LocalQuadratic(max(cost, 0.0), gradient, (derivative @ self.s).reshape(6, 8) @ rows.T)

        return local_quadratic
