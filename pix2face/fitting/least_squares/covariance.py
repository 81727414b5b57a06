"""How far estimated coefficients are from the truth, and in which directions."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray
from scipy.linalg import cho_solve

from pix2face.fitting.least_squares.linear_system import ImageSystem


@final
@dataclass(frozen=True, eq=False)
class CoefficientCovariance:
    """The two parts of the error of estimated coefficients, identity before expression, standard deviations squared.

    Attributes:
        noise: From the noise of the offsets: how estimates of one face scatter.
        shrinkage: From the penalty, which pulls towards the mean face: its mean square over faces that are drawn as
            the model says (unit normal).
    """

    noise: Float64[ndarray, "c c"]
    shrinkage: Float64[ndarray, "c c"]

    @property
    def total(self) -> Float64[ndarray, "c c"]:
        """Of estimate minus truth. Where the noise has variance lambda, this is the posterior covariance."""
        return self.noise + self.shrinkage

    def of_points(self, basis: Float[ndarray, "m 3 c"]) -> Float64[ndarray, "m 3 3"]:
        """Covariance (mm^2) of points of the fitted face, given their basis (mm per standard deviation)."""
        return np.einsum("mac,cd,mbd->mab", basis, self.total, basis, optimize=True)


def coefficient_covariance(
    system: ImageSystem, regularisation: float, noise_variance_mm2: float | None = None
) -> CoefficientCovariance:
    """Covariance of the coefficients that solve a picture's system.

    With G the normal matrix, H = G + lambda I and noise of variance v: v H^-1 G H^-1 and lambda^2 H^-2.

    Args:
        system: As ``measure_picture`` gives it.
        regularisation: lambda in mm^2, as it was solved with.
        noise_variance_mm2: v, of one coordinate of one vertex, where errors are independent; where n vertices share
            one error, n times that. None takes lambda itself, which estimates just this.

    Raises:
        DegenerateGeometryError: lambda is too small for the arithmetic.
    """
    variance = regularisation if noise_variance_mm2 is None else noise_variance_mm2
    inverse = np.asarray(cho_solve(system.factor(regularisation), np.eye(len(system.right))), dtype=np.float64)
    return CoefficientCovariance(
        noise=variance * inverse @ system.normal @ inverse, shrinkage=regularisation**2 * inverse @ inverse
    )
