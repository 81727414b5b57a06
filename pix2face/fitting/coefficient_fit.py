"""Coefficients of the morphable model from the offsets of localised vertices: one linear system.

Of one image (Eq. 4), or of several of one person, who keeps the identity and changes the expression (Eq. 5).
"""

from typing import final

import numpy as np
from jaxtyping import Float, Float64, Int
from numpy import ndarray
from scipy.linalg import cho_solve

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.least_squares.linear_system import ROBUST_ROUNDS, ImageSystem, cholesky, image_system
from pix2face.fitting.prepared_model import vertex_basis
from pix2face.models.morphable_model import MorphableModel


@final
class JointAccumulator:
    """Eq. 5 one picture at a time: its matrix is a block arrow, so each expression is eliminated as its picture comes.

    Time is linear in the number of pictures; what is kept of each is its (expressions x identities) block. Each
    picture is divided by its own lambda, so that a noisy one counts less; the penalty is then |c|^2.

    Args:
        n_identity: How many of the components are identity.
    """

    def __init__(self, n_identity: int) -> None:
        self._n_identity = n_identity
        self._matrix, self._right = np.eye(n_identity), np.zeros(n_identity)
        self._eliminated: list[tuple[Float64[ndarray, " e"], Float64[ndarray, "e k"]]] = []

    def add(self, system: ImageSystem, regularisation: float) -> None:
        """Takes the normal equations of a further picture in.

        Args:
            system: Of the picture.
            regularisation: lambda in mm^2: the variance of what this picture's system should not follow.

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


def fit_coefficients(
    model: MorphableModel,
    vertex_indices: Int[ndarray, " n"],
    offsets: Float[ndarray, "n 3"],
    regularisation: float,
    *,
    robust: bool = True,
) -> tuple[Float64[ndarray, " k"], Float64[ndarray, " e"]]:
    """Solves for identity and expression.

    Minimises sum_j |alpha a_j + beta b_j - s_j|^2 + lambda (|alpha|^2 + |beta|^2).

    Args:
        model: Its bases, in mm per standard deviation, are the a_j and b_j.
        vertex_indices: The localised vertices j.
        offsets: What leads from the mean face to this face there: s_j, in mm.
        regularisation: lambda in mm^2; ``FitOptions`` says how to choose it.
        robust: Solve again with smaller weights for the vertices that disagree.

    Returns:
        Identity and expression coefficients in standard deviations.

    Raises:
        DegenerateGeometryError: No vertex, offsets that are not finite, or lambda not positive.

    Source: Crispell and Bazik 2017, Eq. 4.

    Deviation from the paper: its Tikhonov matrix divides by the standard deviations of the coefficients. Here
    coefficients are in standard deviations, so that matrix is the identity times sqrt(lambda). And its one solve is
    followed by two with the vertices weighted: on exact maps that takes nine tenths off the error of the landmarks.
    """
    basis = vertex_basis(model, vertex_indices).astype(np.float64)
    rounds = ROBUST_ROUNDS if robust else 0
    system = image_system(basis, offsets.astype(np.float64), regularisation, robust_rounds=rounds)
    coefficients = system.solve(regularisation)
    return coefficients[: model.n_identity], coefficients[model.n_identity :]
