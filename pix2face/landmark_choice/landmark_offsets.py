"""Fits how far each landmark lies from its vertex, to the same annotated frames that chose the vertex.

Vertices are 2 to 3 mm apart, and points that belong to another model or that people mark need not lie on the surface.
An offset is a constant vector in the frame of the model, so a landmark moves with its vertex. The offsets of a pair of
landmarks mirror each other if their vertices do, and they are cross-validated like the vertices.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float64, Int
from numpy import ndarray

from pix2face.geometry.camera import Camera
from pix2face.landmark_choice.landmark_selection import VertexSelection, size_px
from pix2face.models.morphable_model import MorphableModel

# Offsets are shrunk as if so many more frames had shown none.
PRIOR_FRAMES = 20
# The mean distance is minimised by weighted least squares, with weights of 1 / distance.
ROUNDS = 10
SMALLEST_DISTANCE = 0.005  # in units of sqrt(w h): the weight of nearer points does not grow further
MIRROR = np.array([-1.0, 1.0, 1.0])


@final
@dataclass(frozen=True, eq=False)
class FittedFrame:
    """A face that was fitted to a frame, and the points that are annotated there."""

    fold: int
    camera: Camera
    coefficients: Float64[ndarray, " c"]  # standard deviations, identity before expression
    annotated: Float64[ndarray, "m 2"]  # pixels; NaN where one is missing


@final
@dataclass(frozen=True, eq=False)
class LandmarkSelection:
    """Where the landmarks of a scheme are, and their errors as shares of sqrt(w h) of the face's box."""

    vertices: Int[ndarray, " m"]  # their numbers in the model
    offsets_mm: Float64[ndarray, "m 3"]  # from these vertices, in the frame of the model
    error: Float64[ndarray, " m"]  # mean over all frames, which chose vertices and offsets: too optimistic
    held_out_error: Float64[ndarray, " m"]  # mean over frames that were not used for the choice
    n_frames: Int[ndarray, " m"]  # how many frames have each landmark


@final
@dataclass(frozen=True, eq=False)
class _Residuals:
    """What is left between landmarks without offsets and the annotated points, in units of sqrt(w h)."""

    beside: Float64[ndarray, "n m 2"]  # NaN where a point is missing
    per_mm: Float64[ndarray, "n m 2 3"]  # how far a landmark moves in the picture for each mm of its offset

    @classmethod
    def of(cls, frames: Sequence[FittedFrame], model: MorphableModel, vertices: Int[ndarray, " m"]) -> "_Residuals":
        basis = np.concatenate([model.identity_basis[:, vertices], model.expression_basis[:, vertices]])
        beside, per_mm = [], []
        for frame in frames:
            points, unit = (
                model.mean[vertices] + np.tensordot(frame.coefficients, basis, axes=1),
                size_px(frame.annotated),
            )
            at = frame.camera.project(points)
            moved = [frame.camera.project(points + step) - at for step in np.eye(3)]
            beside.append((frame.annotated - at) / unit)
            per_mm.append(np.stack(moved, axis=-1) / unit)
        return cls(np.stack(beside), np.stack(per_mm))

    def of_frames(self, chosen: Bool[ndarray, " n"]) -> "_Residuals":
        return _Residuals(self.beside[chosen], self.per_mm[chosen])

    def distances(self, offsets_mm: Float64[ndarray, "m 3"]) -> Float64[ndarray, "n m"]:
        """Distances that are left with given offsets; NaN where a point is missing."""
        left = self.beside - np.einsum("nkij,kj->nki", self.per_mm, offsets_mm)
        return np.asarray(np.linalg.norm(left, axis=2))

    def best_offsets(self, mirror: Sequence[int] | None) -> Float64[ndarray, "m 3"]:
        """The offsets with the smallest mean distance, shrunk by ``PRIOR_FRAMES``."""
        offsets = np.zeros((self.beside.shape[1], 3))
        beside, n_present = np.nan_to_num(self.beside), np.isfinite(self.beside).all(axis=2).sum(axis=0)
        for _ in range(ROUNDS):
            weights = np.nan_to_num(1 / np.maximum(self.distances(offsets), SMALLEST_DISTANCE))
            normal = np.einsum("nk,nkij,nkil->kjl", weights, self.per_mm, self.per_mm)
            right = np.einsum("nk,nkij,nki->kj", weights, self.per_mm, beside)
            if mirror is not None:
                normal = normal + MIRROR[:, None] * normal[list(mirror)] * MIRROR
                right = right + MIRROR * right[list(mirror)]
            shrinking = PRIOR_FRAMES / n_present * np.trace(normal, axis1=1, axis2=2) / 3
            offsets = np.linalg.solve(normal + shrinking[:, None, None] * np.eye(3), right[..., None])[..., 0]
        return np.asarray(offsets)


def select_offsets(
    chosen: VertexSelection, frames: Sequence[FittedFrame], model: MorphableModel, mirror: Sequence[int] | None = None
) -> LandmarkSelection:
    """Fits the offsets of landmarks from their chosen vertices.

    Args:
        chosen: The vertices.
        frames: The frames that chose them. Each landmark is annotated in frames of at least two folds.
        model: The model of the vertices.
        mirror: For each landmark its mirror image, if the vertices were chosen in pairs.
    """
    residuals = _Residuals.of(frames, model, chosen.vertices)
    offsets = residuals.best_offsets(mirror)
    folds, held_out = np.array([frame.fold for frame in frames]), np.zeros(residuals.beside.shape[:2])
    for fold, vertices in enumerate(chosen.without_fold):
        own = folds == fold
        if own.any():
            others = _Residuals.of(frames, model, vertices)
            held_out[own] = others.of_frames(own).distances(others.of_frames(~own).best_offsets(mirror))
    return LandmarkSelection(
        vertices=chosen.vertices,
        offsets_mm=offsets,
        error=np.nanmean(residuals.distances(offsets), axis=0),
        held_out_error=np.nanmean(held_out, axis=0),
        n_frames=chosen.n_frames,
    )
