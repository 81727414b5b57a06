"""How strongly coefficients are held to the mean face: Tikhonov's lambda, as programs and their options name it.

The penalty is lambda |c|^2 with coefficients in standard deviations, so the best lambda is the variance (mm^2) of the
error of one coordinate of one offset, where the errors of the constraints are independent. Errors of a network are
alike over patches of the face: where n constraints share one error, lambda is n times the variance.
"""

import math
from typing import Literal

from pix2face.errors import UsageError

Regularisation = float | Literal["estimate"]

# Exact maps: rounding to 1/128 mm and the mesh's kinks between pixels leave 0.01 mm.
EXACT_MAPS_REGULARISATION = 1e-4
# Predicted maps: landmarks hardly depend on it, and estimating it takes longer than all else
# (docs/explanation/fitting.md).
PREDICTED_MAPS_REGULARISATION = 20.0
# From here on maps are a network's, whose errors are alike over patches; below they may be exact to 0.01 mm.
IS_OF_PREDICTED_MAPS_FROM = 0.5


def check_regularisation(asked: Regularisation) -> None:
    """Refuses what is no lambda.

    Raises:
        UsageError: It is neither positive and finite nor ``estimate``.
    """
    if asked != "estimate" and not 0 < asked < math.inf:
        raise UsageError(f"expected a positive --regularisation in mm^2, or estimate, found {asked}")


def lambda_or_none(asked: Regularisation) -> float | None:
    """As ``fit_face`` takes it, where None means that it estimates lambda."""
    return None if asked == "estimate" else asked
