"""Fits the weights of blendshapes, such as ARKit's, to an expression.

The built-in model has ARKit's 52 expressions in 44 components, so the coefficients alone do not determine the weights.
Weights must therefore be from 0 to 1, and a penalty makes most of them 0.
"""

from typing import Final, final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray
from scipy.optimize import lsq_linear

from pix2face.errors import UsageError
from pix2face.models.morphable_model import MorphableModel

# The penalty draws weights to a negative value, which prefers mixtures of few shapes among similar ones.
PENALTY, DRAWN_TO = 2.0, -0.25
LEFT, RIGHT = "Left", "Right"

# Names of ARFaceAnchor.BlendShapeLocation, in the order of the app Live Link Face.
ARKIT_NAMES: Final = (
    *(
        name + side
        for side in (LEFT, RIGHT)
        for name in ("eyeBlink", "eyeLookDown", "eyeLookIn", "eyeLookOut", "eyeLookUp", "eyeSquint", "eyeWide")
    ),
    *("jawForward", "jawRight", "jawLeft", "jawOpen"),
    *("mouthClose", "mouthFunnel", "mouthPucker", "mouthRight", "mouthLeft"),
    *(name + side for name in ("mouthSmile", "mouthFrown", "mouthDimple", "mouthStretch") for side in (LEFT, RIGHT)),
    *("mouthRollLower", "mouthRollUpper", "mouthShrugLower", "mouthShrugUpper"),
    *(name + side for name in ("mouthPress", "mouthLowerDown", "mouthUpperUp") for side in (LEFT, RIGHT)),
    *("browDownLeft", "browDownRight", "browInnerUp", "browOuterUpLeft", "browOuterUpRight"),
    *("cheekPuff", "cheekSquintLeft", "cheekSquintRight", "noseSneerLeft", "noseSneerRight", "tongueOut"),
)


@final
class BlendshapeSolver:
    """Fits weights of named expressions.

    Args:
        model: Model with these expressions.
        names: Names of the expressions.

    Raises:
        UsageError: The model lacks an expression.
    """

    def __init__(self, model: MorphableModel, names: tuple[str, ...] = ARKIT_NAMES) -> None:
        missing = [name for name in names if name not in model.named_expressions]
        if missing:
            raise UsageError(
                f"expected a model with the {len(names)} expressions {names[0]}, {names[1]}, ... of ARKit, found "
                f"{model.name!r} without {missing[0]}; take the built-in model"
            )
        self.names = names
        shapes = np.stack([model.named_expressions[name] for name in names], axis=1).astype(np.float64)
        self._system = np.vstack([shapes, np.sqrt(PENALTY) * np.eye(len(names))])

    def weights(self, expression: Float[ndarray, " e"]) -> Float64[ndarray, " n"]:
        """Returns the weights w, from 0 to 1, that minimise `|S w - e|^2 + PENALTY |w - DRAWN_TO|^2`.

        The expression e and the named expressions S are in standard deviations.
        """
        right = np.concatenate([expression, np.full(len(self.names), np.sqrt(PENALTY) * DRAWN_TO)])
        return np.asarray(lsq_linear(self._system, right, bounds=(0, 1), method="bvls").x)
