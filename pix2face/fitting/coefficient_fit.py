"""Coefficients of the morphable model from the offsets of localised vertices: one linear system.

Of one image (Eq. 4), or of several of one person, who keeps the identity and changes the expression (Eq. 5).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64, Int
from numpy import ndarray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from pix2face.errors import DegenerateGeometryError
from pix2face.morphable_model import MorphableModel

# The penalty is lambda |c|^2 with coefficients in standard deviations, so the best lambda is the variance (mm^2) of the
# error of one coordinate of one offset, where the errors of the constraints are independent. Errors of a network are
# alike over patches of the face: where n constraints share one error, lambda is n times the variance.
#
# Exact maps: rounding to 1/128 mm and the mesh's kinks between pixels leave 0.01 mm.
EXACT_MAPS_REGULARISATION = 1e-4
# Predicted maps: 1 to 1.5 mm at some 1,500 vertices found, with some 30 independent patches.
PREDICTED_MAPS_REGULARISATION = 80.0

# Vertices at folds and outlines are found on the wrong surface: few, but with errors of a hundred times the others'.
# After each solve a vertex counts as 1 / (1 + (r / (2 m))^2), r its residual and m the median of all (Cauchy's loss).
ROBUST_ROUNDS = 2
CAUCHY_SCALE = 2.0


@final
@dataclass(frozen=True, eq=False)
class _ImageConstraints:
    """The rows that one image adds to Eq. 5.

    Attributes:
        a: Identity basis at the found vertices, mm per standard deviation; x, y and z of each vertex in turn.
        b: Expression basis there.
        s: Offsets there, mm.
    """

    a: Float64[ndarray, "k rows"]
    b: Float64[ndarray, "e rows"]
    s: Float64[ndarray, " rows"]

    def residuals(self, identity: Float64[ndarray, " k"], expression: Float64[ndarray, " e"]) -> Float64[ndarray, " n"]:
        """Distance of each vertex from where the coefficients put it, mm."""
        difference = identity @ self.a + expression @ self.b - self.s
        return np.linalg.norm(difference.reshape(-1, 3), axis=1)


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
        regularisation: lambda in mm^2; see the constants of this module for how to choose it.
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
    identity, expressions = fit_joint_coefficients(model, [(vertex_indices, offsets)], regularisation, robust=robust)
    return identity, expressions[0]


def fit_joint_coefficients(
    model: MorphableModel,
    images: Sequence[tuple[Int[ndarray, " _"], Float[ndarray, "_ 3"]]],
    regularisation: float,
    *,
    robust: bool = True,
) -> tuple[Float64[ndarray, " k"], Float64[ndarray, "n e"]]:
    """Solves for one identity and for the expression in each of several images of one person.

    Args:
        model: As in ``fit_coefficients``.
        images: For each image the localised vertices and their offsets in mm.
        regularisation: As in ``fit_coefficients``.
        robust: As in ``fit_coefficients``.

    Returns:
        Identity and the expressions, in standard deviations.

    Raises:
        DegenerateGeometryError: No image, one without a vertex, offsets that are not finite, or lambda not positive or
            too small for the arithmetic.

    Source: Crispell and Bazik 2017, Eq. 5.
    """
    _check(images, regularisation)
    constraints = [_constraints(model, vertex_indices, offsets) for vertex_indices, offsets in images]
    weights = [np.ones(len(vertex_indices)) for vertex_indices, _ in images]
    identity, expressions = _solve(constraints, weights, regularisation)
    for _ in range(ROBUST_ROUNDS if robust else 0):
        residuals = [
            image.residuals(identity, expression) for image, expression in zip(constraints, expressions, strict=True)
        ]
        scale = CAUCHY_SCALE * float(np.median(np.concatenate(residuals)))
        if not scale > 0:
            break
        weights = [1 / (1 + (residual / scale) ** 2) for residual in residuals]
        identity, expressions = _solve(constraints, weights, regularisation)
    return identity, expressions


def _constraints(
    model: MorphableModel, vertex_indices: Int[ndarray, " n"], offsets: Float[ndarray, "n 3"]
) -> _ImageConstraints:
    n_rows = 3 * len(vertex_indices)  # said, not left to NumPy: a model may lack identities or expressions
    a = np.take(model.identity_basis, vertex_indices, axis=1).reshape(model.n_identity, n_rows).astype(np.float64)
    b = np.take(model.expression_basis, vertex_indices, axis=1).reshape(model.n_expression, n_rows).astype(np.float64)
    return _ImageConstraints(a, b, offsets.reshape(-1).astype(np.float64))


def _solve(
    constraints: Sequence[_ImageConstraints], weights: Sequence[Float64[ndarray, " _"]], regularisation: float
) -> tuple[Float64[ndarray, " k"], Float64[ndarray, "n e"]]:
    """Eq. 5 with a weight for each vertex; the expressions are eliminated image by image."""
    n_identity, n_expression = len(constraints[0].a), len(constraints[0].b)
    identity_matrix = regularisation * np.eye(n_identity)
    identity_vector = np.zeros(n_identity)
    eliminated = []
    for image, weight in zip(constraints, weights, strict=True):
        root = np.repeat(np.sqrt(weight), 3)
        weighted = np.concatenate([image.a, image.b]) * root
        normal, right = weighted @ weighted.T, weighted @ (root * image.s)
        aa, ab = normal[:n_identity, :n_identity], normal[:n_identity, n_identity:]
        bb = normal[n_identity:, n_identity:]
        factor = _factor(bb + regularisation * np.eye(n_expression), regularisation)
        # beta = from_offsets - from_identity alpha, whatever alpha is.
        from_offsets, from_identity = cho_solve(factor, right[n_identity:]), cho_solve(factor, ab.T)
        identity_matrix += aa - ab @ from_identity
        identity_vector += right[:n_identity] - ab @ from_offsets
        eliminated.append((from_offsets, from_identity))
    identity = np.asarray(cho_solve(_factor(identity_matrix, regularisation), identity_vector), dtype=np.float64)
    return identity, np.stack([from_offsets - matrix @ identity for from_offsets, matrix in eliminated])


def _factor(matrix: Float64[ndarray, "n n"], regularisation: float) -> tuple[ndarray, bool]:
    try:
        factor: tuple[ndarray, bool] = cho_factor(matrix)
    except LinAlgError as error:
        raise DegenerateGeometryError(
            f"expected a regularisation with which the coefficients can be solved for, found {regularisation:g}; "
            "take a larger one"
        ) from error
    return factor


def _check(images: Sequence[tuple[Int[ndarray, " _"], Float[ndarray, "_ 3"]]], regularisation: float) -> None:
    if not images or any(len(vertex_indices) == 0 for vertex_indices, _ in images):
        raise DegenerateGeometryError("expected vertices to fit the coefficients to, found none")
    n_bad = sum(int((~np.isfinite(offsets)).sum()) for _, offsets in images)
    if n_bad or not 0 < regularisation < np.inf:
        raise DegenerateGeometryError(
            f"expected finite offsets and a positive regularisation, found {regularisation} and "
            f"{n_bad} values that are not finite"
        )
