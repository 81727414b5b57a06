"""Coefficients of the morphable model from the offsets of localised vertices: one linear system."""

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
    if len(vertex_indices) == 0:
        raise DegenerateGeometryError("expected vertices to fit the coefficients to, found none")
    if not (np.isfinite(offsets).all() and regularisation > 0):
        raise DegenerateGeometryError(
            f"expected finite offsets and a positive regularisation, found {regularisation} and "
            f"{int((~np.isfinite(offsets)).sum())} values that are not finite"
        )
    bases = [model.identity_basis[:, vertex_indices], model.expression_basis[:, vertex_indices]]
    basis = np.concatenate(bases).reshape(model.n_identity + model.n_expression, -1).astype(np.float64)
    # Eq. (4) as normal equations with Tikhonov's term.
    matrix = basis @ basis.T + regularisation * np.eye(len(basis))
    coefficients = np.asarray(cho_solve(cho_factor(matrix), basis @ offsets.reshape(-1).astype(np.float64)))
    return coefficients[: model.n_identity], coefficients[model.n_identity :]
