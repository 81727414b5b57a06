"""Weights of named expressions: the mixture of blendshapes, such as ARKit's, that comes nearest to a fitted expression.

The built-in model has ARKit's 52 expressions in 44 components, so a mixture is not determined by its coefficients
alone; it is as far as weights are from 0 to 1 and most of them are 0.
"""

from typing import Final, final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray
from scipy.optimize import lsq_linear

from pix2face.errors import UsageError
from pix2face.models.morphable_model import MorphableModel

# Weights are drawn to a value below 0, so that of mixtures that are about equally near, one of few shapes wins.
PENALTY, DRAWN_TO = 2.0, -0.25
LEFT, RIGHT = "Left", "Right"

# ARFaceAnchor.BlendShapeLocation, in the order in which the app Live Link Face lists them.
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
    """Finds weights of named expressions.

    Args:
        model: A model that has these expressions.
        names: The expressions.

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
        """The weights w, from 0 to 1, whose mixture S w is near to an expression e, both in standard deviations.

        Minimises |S w - e|^2 + PENALTY |w - DRAWN_TO|^2.
        """
        right = np.concatenate([expression, np.full(len(self.names), np.sqrt(PENALTY) * DRAWN_TO)])
        return np.asarray(lsq_linear(self._system, right, bounds=(0, 1), method="bvls").x)
