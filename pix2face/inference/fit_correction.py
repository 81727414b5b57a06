"""The correction of fits in use: ``pix2face.networks.correction.FitCorrection.corrected`` in NumPy, for one face."""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from pix2face.geometry.camera import Camera, affine_camera
from pix2face.inference.weight_files import Weights
from pix2face.networks.dimensions import (
    CAMERA_CHANGES,
    CAMERA_FACTS,
    CHANGE,
    CORRECTION_PLACES,
    CORRECTION_WIDTHS,
    FARTHEST_FACT,
    GROWTH,
    PICTURE_FEATURES,
    SHIFT,
    TURN,
)


@final
@dataclass(frozen=True, eq=False)
class FitCorrection:
    """Corrects a weak-perspective camera and coefficients by what the network has seen of the face."""

    fact_mean: Float32[ndarray, " f"]
    fact_deviation: Float32[ndarray, " f"]
    facts: tuple[Float32[ndarray, "p f"], Float32[ndarray, " p"]]  # matrix and bias, like the next ones
    first: tuple[Float32[ndarray, "p n"], Float32[ndarray, " p"]]  # its norm is folded
    second: tuple[Float32[ndarray, "m p"], Float32[ndarray, " m"]]

    @classmethod
    def of(cls, weights: Weights, coefficients: int) -> "FitCorrection":
        """Takes the weights of a correction of so many coefficients.

        Raises:
            ValueError: An array is missing or has another shape.
        """
        n_facts, seen = CAMERA_FACTS + coefficients, CORRECTION_WIDTHS[-1] * CORRECTION_PLACES**2

        def take(name: str, *shape: int) -> Float32[ndarray, "..."]:
            return weights.take(f"correction.{name}", *shape)

        first = take("first.weight", PICTURE_FEATURES, seen + PICTURE_FEATURES)
        mean, deviation = weights.take_norm("correction.first_norm", PICTURE_FEATURES)
        gain = take("first_norm.weight", PICTURE_FEATURES) / deviation
        return cls(
            *weights.take_norm("correction.fact_norm", n_facts),
            (take("facts.weight", PICTURE_FEATURES, n_facts), take("facts.bias", PICTURE_FEATURES)),
            (gain[:, None] * first, take("first_norm.bias", PICTURE_FEATURES) - gain * mean),
            (
                take("second.weight", CAMERA_CHANGES + coefficients, PICTURE_FEATURES),
                take("second.bias", CAMERA_CHANGES + coefficients),
            ),
        )

    def corrected(
        self, seen: Float32[ndarray, " k"], camera: Camera, coefficients: Float64[ndarray, " c"], size_px: int
    ) -> tuple[Camera, Float64[ndarray, " c"]]:
        """Returns a camera and coefficients that are nearer to the true ones.

        Args:
            seen: What the network saw of the face (``Answers.seen``).
            camera: Fitted, from mm to pixels of the crop.
            coefficients: Fitted, standard deviations, identity before expression.
            size_px: Side of the crop.
        """
        rows = centred_rows(camera, size_px)
        lengths = np.linalg.norm(rows[:, :3], axis=1)
        right, down = rows[:, :3] / lengths[:, None]
        rotation, scale = np.stack([right, down, np.cross(right, down)]), lengths.mean()
        known = np.concatenate([rotation.ravel(), [np.log(scale)], rows[:, 3], coefficients])
        facts = np.clip((known - self.fact_mean) / self.fact_deviation, -FARTHEST_FACT, FARTHEST_FACT)
        features = np.concatenate([seen, _relu(_linear(self.facts, facts.astype(np.float32)))])
        changes = _linear(self.second, _relu(_linear(self.first, features))).astype(float)
        turn = cv2.Rodrigues(TURN * changes[:3])[0] @ rotation
        rows = np.column_stack(
            [scale * np.exp(GROWTH * changes[3]) * turn[:2], rows[:, 3] + SHIFT * changes[4:CAMERA_CHANGES]]
        )
        return camera_of_rows(rows, size_px), coefficients + CHANGE * changes[CAMERA_CHANGES:]


def centred_rows(camera: Camera, size_px: int) -> Float64[ndarray, "2 4"]:
    """The rows of an affine camera, in units of the picture's side from its middle."""
    rows = camera.matrix[:2] / size_px
    rows[:, 3] -= 0.5
    return rows


def camera_of_rows(rows: Float64[ndarray, "2 4"], size_px: int) -> Camera:
    """The inverse of ``centred_rows``."""
    rows = rows.copy()
    rows[:, 3] += 0.5
    return affine_camera(size_px * rows)


def _linear(layer: tuple[ndarray, ndarray], x: Float32[ndarray, " n"]) -> Float32[ndarray, " m"]:
    matrix, bias = layer
    return np.asarray(matrix @ x + bias)


def _relu(x: Float32[ndarray, " n"]) -> Float32[ndarray, " n"]:
    return np.maximum(x, 0)
