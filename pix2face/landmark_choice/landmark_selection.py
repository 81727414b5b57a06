"""Chooses the vertex of a model for each landmark from annotated frames.

Each frame has a fitted face (camera and mesh) and annotated points. Of all vertices of the face the one whose
projections lie nearest to a landmark's annotations, on average over the frames, becomes that landmark. The choice is
cross-validated: the frames are split into folds, and each fold is measured with the vertices that the other folds
choose.

Where a model knows its mirror image, the two landmarks of a pair become two vertices that mirror each other, and those
on the midline become vertices of the midline. Otherwise, the vertices would follow whatever the annotations have to one
side, and a mirrored picture would have other landmarks.

Source: Crispell and Bazik 2017, Section 4 ("Landmark Localization").

Deviation from the paper: errors are divided by the size of the face before they are averaged, so that frames count
alike whatever their resolution; vertices are chosen in pairs; and the error is cross-validated.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64, Int
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.geometry.crops import FaceBox

LEAST_FOLDS = 2


@final
@dataclass(frozen=True, eq=False)
class VertexSelection:
    """The vertices chosen for the landmarks of a scheme, and their errors as shares of sqrt(w h) of the face's box."""

    vertices: Int[ndarray, " m"]  # their numbers in the model
    without_fold: Int[ndarray, "k m"]  # those that are chosen without the frames of each fold
    error: Float64[ndarray, " m"]  # mean over all frames, which chose the vertices: too optimistic
    held_out_error: Float64[ndarray, " m"]  # mean over frames that were not used for the choice
    n_frames: Int[ndarray, " m"]  # how many frames have each landmark


@final
@dataclass(frozen=True, eq=False)
class MirrorImages:
    """Which landmark, and which vertex of the model, is the mirror image of which."""

    landmarks: Sequence[int]  # for each landmark
    vertices: Int[ndarray, " v"]  # for each vertex of the model


@final
class ReprojectionErrors:
    """Sums of reprojection errors by fold, landmark and candidate vertex; memory does not grow with the frames.

    Args:
        candidates: The vertices to choose from.
        n_landmarks: Points in the scheme.
        n_folds: Parts of the frames that are held out in turn.
        mirror: Mirror images, if vertices are to be chosen in pairs. Each candidate's image must be a candidate.

    Raises:
        UsageError: Fewer than two folds.
    """

    def __init__(
        self, candidates: Int[ndarray, " v"], n_landmarks: int, n_folds: int, mirror: MirrorImages | None = None
    ) -> None:
        if n_folds < LEAST_FOLDS:
            raise UsageError(f"--folds: expected {LEAST_FOLDS} or more, found {n_folds}")
        self._candidates = candidates
        self._mirror = mirror
        self._sums = np.zeros((n_folds, n_landmarks, len(candidates)))
        self._counts = np.zeros((n_folds, n_landmarks), dtype=np.int64)

    def add(self, fold: int, projected: Float[ndarray, "v 2"], annotated: Float64[ndarray, "m 2"]) -> None:
        """Adds the errors of one frame.

        Args:
            fold: Which part of the frames it belongs to.
            projected: The candidates in the picture, pixels.
            annotated: The landmarks in the picture, pixels; NaN where one is missing.

        Raises:
            DegenerateGeometryError: The annotated points have no extent, or the projections are not finite.
        """
        present = np.isfinite(annotated).all(axis=1)
        if not np.isfinite(projected).all():
            raise DegenerateGeometryError("expected a fit with finite projections, found some that are not")
        if not size_px(annotated) > 0:
            raise DegenerateGeometryError("expected annotated points around a face, found them all in one line")
        for landmark in np.flatnonzero(present):
            distances = np.linalg.norm(projected - annotated[landmark], axis=1)
            self._sums[fold, landmark] += distances / size_px(annotated)
        self._counts[fold] += present

    def of(self, vertices: Int[ndarray, " m"]) -> Float64[ndarray, " m"]:
        """Mean error of given vertices, one a landmark, over all frames; NaN for one that is no candidate."""
        place = {int(vertex): index for index, vertex in enumerate(self._candidates)}
        mean = self._sums.sum(axis=0) / np.maximum(self._counts.sum(axis=0), 1)[:, None]
        return np.array([mean[row, place[int(v)]] if int(v) in place else np.nan for row, v in enumerate(vertices)])

    def select(self) -> VertexSelection:
        """Chooses the vertices.

        Raises:
            UsageError: A landmark is annotated in too few frames to be chosen and checked.
        """
        counts, sums = self._counts.sum(axis=0), self._sums.sum(axis=0)
        seldom = np.flatnonzero(((counts - self._counts) == 0).any(axis=0))
        if len(seldom):
            raise UsageError(
                f"expected every landmark in frames of at least two folds, found landmark {seldom[0]} in "
                f"{counts[seldom[0]]} frames; give more frames, or fewer --folds"
            )
        rows = np.arange(len(counts))
        chosen = self._best(sums)
        others = [self._best(sums - own) for own in self._sums]
        held_out = np.stack([own[rows, choice] for own, choice in zip(self._sums, others, strict=True)]).sum(axis=0)
        return VertexSelection(
            vertices=self._candidates[chosen],
            without_fold=self._candidates[np.stack(others)],
            error=sums[rows, chosen] / counts,
            held_out_error=held_out / counts,
            n_frames=counts,
        )

    def _best(self, sums: Float64[ndarray, "m v"]) -> Int[ndarray, " m"]:
        """For each landmark the candidate (an index) of the smallest sum of errors."""
        if self._mirror is None:
            return sums.argmin(axis=1)
        image = np.searchsorted(self._candidates, self._mirror.vertices[self._candidates])
        others = np.array(self._mirror.landmarks)
        both = sums + sums[others][:, image]
        on_midline = (others == np.arange(len(sums)))[:, None]
        both[on_midline & (image != np.arange(len(image)))] = np.inf
        best = both.argmin(axis=1)
        is_second = others < np.arange(len(sums))
        best[is_second] = image[best[others[is_second]]]
        return best


def size_px(annotated: Float64[ndarray, "m 2"]) -> float:
    """What errors are divided by: sqrt(w h) of the box of the annotated points.

    Raises:
        DegenerateGeometryError: The points have no extent.
    """
    box = FaceBox.around(annotated)
    return float(np.sqrt(box.width * box.height))


def fold_of_frame(index: int, n_frames: int, n_folds: int) -> int:
    """The fold of a frame in the order of names: runs of neighbours, so that a clip's frames stay together."""
    return index * n_folds // n_frames
