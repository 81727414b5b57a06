"""Coefficients of the morphable model from the offsets of localised vertices: one linear system.

Of one image (Eq. 4), or of several of one person, who keeps the identity and changes the expression (Eq. 5).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float64, Int
from numpy import ndarray
from scipy.linalg import cho_factor, cho_solve

from pix2face.errors import DegenerateGeometryError
from pix2face.morphable_model import MorphableModel

# The penalty is lambda |c|^2 with coefficients in standard deviations, so the best lambda is the variance (mm^2) of the
# error of one coordinate of one offset, where the errors of the constraints are independent. Errors of a network are
# alike over patches of the face: where n constraints share one error, lambda is n times the variance.
#
# Exact maps: rounding to 1/128 mm has a variance of 5e-6 mm^2; the mesh's kinks between pixels add about 1e-3 mm^2.
EXACT_MAPS_REGULARISATION = 1e-3
# Predicted maps: 1 mm at 2,000 vertices with some 50 independent patches.
PREDICTED_MAPS_REGULARISATION = 40.0


def fit_coefficients(
    model: MorphableModel,
    vertex_indices: Int[ndarray, " n"],
    offsets: Float[ndarray, "n 3"],
    regularisation: float,
) -> tuple[Float64[ndarray, " k"], Float64[ndarray, " e"]]:
    """Solves for identity and expression.

    Minimises sum_j |alpha a_j + beta b_j - s_j|^2 + lambda (|alpha|^2 + |beta|^2).

    Args:
        model: Its bases, in mm per standard deviation, are the a_j and b_j.
        vertex_indices: The localised vertices j.
        offsets: What leads from the mean face to this face there: s_j, in mm.
        regularisation: lambda in mm^2; see the constants of this module for how to choose it.

    Returns:
        Identity and expression coefficients in standard deviations.

    Raises:
        DegenerateGeometryError: No vertex, offsets that are not finite, or lambda not positive.

    Source: Crispell and Bazik 2017, Eq. 4.

    Deviation from the paper: its Tikhonov matrix divides by the standard deviations of the coefficients. Here
    coefficients are in standard deviations, so that matrix is the identity times sqrt(lambda).
    """
    identity, expressions = fit_joint_coefficients(model, [(vertex_indices, offsets)], regularisation)
    return identity, expressions[0]


def fit_joint_coefficients(
    model: MorphableModel,
    images: Sequence[tuple[Int[ndarray, " _"], Float[ndarray, "_ 3"]]],
    regularisation: float,
) -> tuple[Float64[ndarray, " k"], Float64[ndarray, "n e"]]:
    """Solves for one identity and for the expression in each of several images of one person.

    The expressions are eliminated image by image, so the largest system has the size of the identity.

    Args:
        model: As in ``fit_coefficients``.
        images: For each image the localised vertices and their offsets in mm.
        regularisation: As in ``fit_coefficients``.

    Returns:
        Identity and the expressions, in standard deviations.

    Raises:
        DegenerateGeometryError: No image, one without a vertex, offsets that are not finite, or lambda not positive.

    Source: Crispell and Bazik 2017, Eq. 5.
    """
    _check(images, regularisation)
    identity_matrix = regularisation * np.eye(model.n_identity)
    identity_vector = np.zeros(model.n_identity)
    expression_solutions = []
    for vertex_indices, offsets in images:
        a = model.identity_basis[:, vertex_indices].reshape(model.n_identity, -1).astype(np.float64)
        b = model.expression_basis[:, vertex_indices].reshape(model.n_expression, -1).astype(np.float64)
        s = offsets.reshape(-1).astype(np.float64)
        # Eq. (5): beta = from_offsets - from_identity alpha, whatever alpha is.
        factor = cho_factor(b @ b.T + regularisation * np.eye(model.n_expression))
        from_offsets, from_identity = cho_solve(factor, b @ s), cho_solve(factor, b @ a.T)
        identity_matrix += a @ a.T - (a @ b.T) @ from_identity
        identity_vector += a @ s - (a @ b.T) @ from_offsets
        expression_solutions.append((from_offsets, from_identity))
    identity = np.asarray(cho_solve(cho_factor(identity_matrix), identity_vector), dtype=np.float64)
    expressions = np.stack([offset - matrix @ identity for offset, matrix in expression_solutions])
    return identity, expressions


def _check(images: Sequence[tuple[Int[ndarray, " _"], Float[ndarray, "_ 3"]]], regularisation: float) -> None:
    if not images or any(len(vertex_indices) == 0 for vertex_indices, _ in images):
        raise DegenerateGeometryError("expected vertices to fit the coefficients to, found none")
    n_bad = sum(int((~np.isfinite(offsets)).sum()) for _, offsets in images)
    if n_bad or not regularisation > 0:
        raise DegenerateGeometryError(
            f"expected finite offsets and a positive regularisation, found {regularisation} and "
            f"{n_bad} values that are not finite"
        )
