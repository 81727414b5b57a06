"""Weak perspective from moments: with the points summed up once, each step of the fit costs the same for any number.

The residuals of a camera without perspective are linear in its 2 x 4 matrix M, so their weighted sum of squares is
tr(M S M^T) - 2 tr(M C^T) + w with three sums over the points.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.fitting.least_squares.levenberg_marquardt import LocalQuadratic
from pix2face.fitting.least_squares.similarity import Similarity


def stacked(points3d: Float[ndarray, "n 3"], points2d: Float[ndarray, "n 2"]) -> Float64[ndarray, "n 6"]:
    """Correspondences as rows (x, 1, u). Points should be relative to their centres, or digits are lost."""
    return np.column_stack([points3d, np.ones(len(points3d)), points2d])


@final
@dataclass(frozen=True, eq=False)
class Moments:
    """Weighted sums over 3D-2D correspondences, with y = (x, 1)."""

    s: Float64[ndarray, "4 4"]  # sum of y y^T
    c: Float64[ndarray, "2 4"]  # sum of u y^T
    w: float  # sum of |u|^2

    @classmethod
    def of(cls, rows: Float64[ndarray, "n 6"], weights: Float64[ndarray, " n"]) -> "Moments":
        """Computes the sums from the rows of ``stacked``."""
        sums = (rows * weights[:, None]).T @ rows
        return cls(sums[:4, :4], sums[4:, :4], float(sums[4, 4] + sums[5, 5]))

    def quadratic(self, state: Similarity) -> LocalQuadratic:
        """The local quadratic of half the weighted sum of squares, as ``minimise`` takes it."""
        ms = state.matrix @ self.s
        cost = float(((ms - 2 * self.c) * state.matrix).sum() + self.w) / 2
        rows = state.derivative.reshape(6, 8)
        hessian = (state.derivative @ self.s).reshape(6, 8) @ rows.T
        return LocalQuadratic(max(cost, 0.0), rows @ (ms - self.c).reshape(8), hessian)
