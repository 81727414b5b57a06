"""Mirrored faces: which models have them, and what changes in a sample.

A mirrored picture of a face is a picture of the mirrored face. Its PNCC and offsets are those of the picture with
left and right exchanged and the sign of x changed, if the model's mean is its own mirror image.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64, Shaped
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.geometry.landmarks import IBUG68, MIRROR_IBUG68
from pix2face.models.morphable_model import MorphableModel

# As exact as shards hold maps.
LARGEST_ASYMMETRY_MM = 0.01
# Landmarks are vertices picked by hand: their twins may be a vertex beside.
LARGEST_LANDMARK_ASYMMETRY_MM = 3.0


def mirror_obstacle(model: MorphableModel) -> str | None:
    """The reason why samples of a model cannot be mirrored; None if they can.

    They can where the model knows the mirror image of each vertex, where its mean face is symmetric (otherwise the
    mirrored PNCC is that of no vertex), and where the landmarks of left and right lie opposite each other.
    """
    if model.symmetry is None:
        return f"the model {model.name} does not say which vertices are mirror images of each other"
    asymmetry = float(np.abs(mirrored_points(model.mean)[model.symmetry] - model.mean).max())
    if not asymmetry <= LARGEST_ASYMMETRY_MM:
        return (
            f"the mean face of {model.name} is not symmetric: the halves differ by up to {asymmetry:.2f} mm "
            f"(at most {LARGEST_ASYMMETRY_MM} mm are allowed), so a mirrored PNCC would be that of another face"
        )
    if IBUG68 in model.landmarks:
        landmarks = model.mean[model.landmarks[IBUG68]]
        worst = float(np.linalg.norm(mirrored_landmarks(mirrored_points(landmarks)) - landmarks, axis=1).max())
        if not worst <= LARGEST_LANDMARK_ASYMMETRY_MM:
            return f"the left and right landmarks of {model.name} are {worst:.1f} mm from being mirror images"
    return None


def mirrored_points(points: Float[ndarray, "*n 3"]) -> Float[ndarray, "*n 3"]:
    """Points of the model frame seen in the mirror: the sign of x changes."""
    return points * np.array([-1, 1, 1], dtype=points.dtype)


def mirrored_landmarks(landmarks: Shaped[ndarray, "68 ..."]) -> Shaped[ndarray, "68 ..."]:
    """Reorders mirrored landmarks, or their visibilities: the corner of the left eye becomes that of the right eye."""
    return landmarks[list(MIRROR_IBUG68)]


@final
@dataclass(frozen=True, eq=False)
class MirroredCoefficients:
    """Matrices that turn the coefficients of a face into those of its mirror image; they multiply from the right."""

    identity: Float64[ndarray, "k k"]
    expression: Float64[ndarray, "e e"]
    # How far a vertex may lie from the mirror image, for one standard deviation of one component.
    largest_error_mm: float


def mirrored_coefficients(model: MorphableModel) -> MirroredCoefficients:
    """Finds the coefficients of mirrored faces by least squares over the vertices of the face.

    Raises:
        UsageError: The model has no mirror image (``mirror_obstacle``).
    """
    obstacle = mirror_obstacle(model)
    if obstacle or model.symmetry is None:
        raise UsageError(f"expected a model whose faces can be mirrored, but {obstacle}")
    matrices, errors = [], [0.0]
    for basis in (model.identity_basis, model.expression_basis):
        twins = mirrored_points(basis)[:, model.symmetry]
        rows, twin_rows = (values.reshape(len(basis), basis[0].size).astype(np.float64) for values in (basis, twins))
        # Of the normal equations, a few hundred squared: the bases themselves are large.
        matrix = np.linalg.lstsq(rows @ rows.T, rows @ twin_rows.T, rcond=None)[0].T
        matrices.append(matrix)
        if len(basis):
            distances = np.linalg.norm((matrix @ rows - twin_rows).reshape(len(basis), -1, 3), axis=2)
            errors.append(float(distances.max()))
    return MirroredCoefficients(matrices[0], matrices[1], max(errors))
