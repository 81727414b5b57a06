"""The linear system of the coefficients: offsets of found vertices on one side, the bases there on the other.

Of one picture (Eq. 4), or of several of one person, who keeps the identity and changes the expression (Eq. 5).
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.least_squares.robust import lengths

# Vertices at folds and outlines are found on the wrong surface: few, but with errors of a hundred times the others'.
# After each solve a vertex counts as (t / r)^2 where its residual r exceeds t, this multiple of the median residual.
# The others keep their weight, so that lambda keeps its meaning and only few rows of the system change.
ROBUST_ROUNDS = 2
# In predicted maps, a second round hardly changes the result (docs/explanation/fitting.md).
PREDICTED_MAPS_ROUNDS = 1
THRESHOLD_IN_MEDIANS = 2.0


@final
@dataclass(frozen=True, eq=False)
class ImageSystem:
    """The normal equations of one picture, without the penalty."""

    normal: Float64[ndarray, "c c"]  # A^T W A, identity before expression
    right: Float64[ndarray, " c"]  # A^T W s
    weights: Float64[ndarray, " n"]  # W: the factor of each vertex, 0 to 1
    offsets_only: "ImageSystem | None" = None  # this system before rows were added to it; None where none were

    def solve(self, regularisation: float) -> Float64[ndarray, " c"]:
        """The coefficients of this picture alone.

        Raises:
            DegenerateGeometryError: lambda is too small for the arithmetic.
        """
        return np.asarray(cho_solve(self.factor(regularisation), self.right, check_finite=False), dtype=np.float64)

    def factor(self, regularisation: float) -> tuple[ndarray, bool]:
        """Cholesky's factor of the normal matrix with the penalty.

        Raises:
            DegenerateGeometryError: As ``solve``.
        """
        return cholesky(self.normal + regularisation * np.eye(len(self.right)), regularisation)


def image_system(
    basis: Float[ndarray, "n 3 c"], offsets: Float[ndarray, "n 3"], regularisation: float, *, robust_rounds: int
) -> ImageSystem:
    """Sets up the normal equations in the precision of the basis.

    Their solution minimises sum_j w_j |alpha a_j + beta b_j - s_j|^2 + lambda (|alpha|^2 + |beta|^2) with offsets s_j.

    Args:
        basis: mm per standard deviation at the found vertices, identity before expression.
        offsets: What leads from the mean face to this face there, mm.
        regularisation: lambda in mm^2: what the residuals that make the weights are measured with.
        robust_rounds: How often vertices that disagree with the solution get a smaller weight; 0 leaves all at 1.

    Raises:
        DegenerateGeometryError: No vertex, offsets that are not finite, lambda not positive or too small.

    Source: Crispell and Bazik 2017, Eq. 4.

    Deviation from the paper: its Tikhonov matrix divides by the standard deviations of the coefficients. Here
    coefficients are in standard deviations, so that matrix is the identity times sqrt(lambda). And its one solve is
    followed by two with the vertices weighted: on exact maps that takes nine tenths off the error of the landmarks.
    """
    check_system(offsets, regularisation)
    rows = basis.reshape(-1, basis.shape[2])
    targets = offsets.reshape(-1).astype(basis.dtype)
    plain = ImageSystem(*_normal_equations(rows, targets), np.ones(len(offsets)))
    system = plain
    for _ in range(robust_rounds):
        difference = rows @ system.solve(regularisation).astype(rows.dtype) - targets
        weights = _robust_weights(lengths(difference.reshape(-1, 3)))
        light = np.flatnonzero(weights < 1)
        if len(light) == 0:
            break
        # Only the rows that lose weight are multiplied again.
        lost = np.sqrt(1 - weights[light]).astype(basis.dtype)
        lost_rows = (basis[light] * lost[:, None, None]).reshape(-1, basis.shape[2])
        normal, right = _normal_equations(lost_rows, (offsets[light] * lost[:, None]).reshape(-1).astype(basis.dtype))
        system = ImageSystem(plain.normal - normal, plain.right - right, weights)
    return system


@final
class JointAccumulator:
    """Eq. 5 one picture at a time: its matrix is a block arrow, so each expression is eliminated as its picture comes.

    Time is linear in the number of pictures; what is kept of each is its (expressions x identities) block. Each
    picture is divided by its own lambda, so that a noisy one counts less; the penalty is then |c|^2. The first
    ``n_identity`` components are identity.
    """

    def __init__(self, n_identity: int) -> None:
        self._n_identity = n_identity
        self._matrix, self._right = np.eye(n_identity), np.zeros(n_identity)
        self._eliminated: list[tuple[Float64[ndarray, " e"], Float64[ndarray, "e k"]]] = []

    def add(self, system: ImageSystem, regularisation: float) -> None:
        """Takes in a further picture and its lambda (mm^2): the variance of what its system should not follow.

        Raises:
            DegenerateGeometryError: lambda is too small for the arithmetic.
        """
        k = self._n_identity
        normal, right = system.normal / regularisation, system.right / regularisation
        aa, ab, bb = normal[:k, :k], normal[:k, k:], normal[k:, k:]
        factor = cholesky(bb + np.eye(len(bb)), regularisation)
        # beta = from_offsets - from_identity alpha, whatever alpha is.
        from_offsets = np.asarray(cho_solve(factor, right[k:]), dtype=np.float64)
        from_identity = np.asarray(cho_solve(factor, ab.T), dtype=np.float64)
        self._matrix += aa - ab @ from_identity
        self._right += right[:k] - ab @ from_offsets
        self._eliminated.append((from_offsets, from_identity))

    def solve(self) -> tuple[Float64[ndarray, " k"], Float64[ndarray, "n e"]]:
        """The identity of all pictures so far, and the expression in each, in standard deviations.

        Raises:
            DegenerateGeometryError: No picture yet, or lambda is too small for the arithmetic.
        """
        if not self._eliminated:
            raise DegenerateGeometryError("expected pictures to fit the coefficients to, found none")
        factor = cholesky(self._matrix, 1.0)
        identity = np.asarray(cho_solve(factor, self._right), dtype=np.float64)
        expressions = [from_offsets - matrix @ identity for from_offsets, matrix in self._eliminated]
        return identity, np.stack(expressions)


def cholesky(matrix: Float64[ndarray, "n n"], regularisation: float) -> tuple[ndarray, bool]:
    """Cholesky's factor for ``cho_solve``.

    Raises:
        DegenerateGeometryError: lambda is too small for the arithmetic.
    """
    try:
        factor: tuple[ndarray, bool] = cho_factor(matrix, check_finite=False)
    except LinAlgError as error:
        raise DegenerateGeometryError(
            f"expected a regularisation with which the coefficients can be solved for, found {regularisation:g}; "
            "take a larger one"
        ) from error
    return factor


def check_system(offsets: Float[ndarray, "n 3"], regularisation: float) -> None:
    """Refuses what cannot be solved.

    Raises:
        DegenerateGeometryError: No vertex, offsets that are not finite, or lambda not positive.
    """
    if len(offsets) == 0:
        raise DegenerateGeometryError("expected vertices to fit the coefficients to, found none")
    n_bad = int((~np.isfinite(offsets)).sum())
    if n_bad or not 0 < regularisation < np.inf:
        raise DegenerateGeometryError(
            f"expected finite offsets and a positive regularisation, found {regularisation} and "
            f"{n_bad} values that are not finite"
        )


def _normal_equations(
    rows: Float[ndarray, "r c"], targets: Float[ndarray, " r"]
) -> tuple[Float64[ndarray, "c c"], Float64[ndarray, " c"]]:
    return (rows.T @ rows).astype(np.float64), (targets @ rows).astype(np.float64)


def _robust_weights(residuals: Float[ndarray, " n"]) -> Float64[ndarray, " n"]:
    # Where the fit is perfect the median is 0; those vertices must keep their weight.
    threshold = max(THRESHOLD_IN_MEDIANS * float(np.median(residuals)), 1e-30)
    return np.asarray((threshold / np.maximum(residuals, threshold)) ** 2, dtype=np.float64)
