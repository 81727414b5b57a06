"""The interface of detectors, and helpers for the boxes that they return."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

from jaxtyping import UInt8
from numpy import ndarray

from pix2face.detectors import SURE_SCORE
from pix2face.geometry.crops import FaceBox


@final
@dataclass(frozen=True)
class DetectedFace:
    """A detected face, or a candidate for one.

    Attributes:
        box: The tight box of its 68 landmarks, as far as the detector can tell; pixels.
        score: Larger means surer. The detector is sure of faces with at least 1; lower scores are doubtful.
    """

    box: FaceBox
    score: float


Box = FaceBox | DetectedFace  # given, or found with a score


@runtime_checkable
class Detector(Protocol):
    """Finds faces."""

    def detect(self, image: UInt8[ndarray, "h w 3"]) -> list[FaceBox]:
        """The boxes of the faces that the detector is sure of, in pixels of the RGB picture, largest first."""

    def candidates(self, image: UInt8[ndarray, "h w 3"]) -> list[DetectedFace]:
        """The sure and the doubtful faces, surest first."""


def sure_faces(candidates: Sequence[DetectedFace], min_score: float = SURE_SCORE) -> list[DetectedFace]:
    """The faces with a score of at least ``min_score``, largest first."""
    return sorted((face for face in candidates if face.score >= min_score), key=lambda face: -face.box.longer_side)


def sure_boxes(candidates: Sequence[DetectedFace]) -> list[FaceBox]:
    """The boxes of the faces with a score of at least 1, largest first."""
    return [face.box for face in sure_faces(candidates)]


def box_and_score(face: Box) -> tuple[FaceBox, float | None]:
    """The box of a face and its score, which is None for a box that somebody gave."""
    return (face.box, face.score) if isinstance(face, DetectedFace) else (face, None)


def overlap(first: FaceBox, second: FaceBox) -> float:
    """Intersection over union of two boxes, 0 to 1."""
    width = min(first.right, second.right) - max(first.left, second.left)
    height = min(first.bottom, second.bottom) - max(first.top, second.top)
    common = max(width, 0.0) * max(height, 0.0)
    union = first.width * first.height + second.width * second.height - common
    return float(common / union) if union > 0 else 0.0


def without_doubles(faces: Sequence[DetectedFace], at_most: float) -> list[DetectedFace]:
    """Leaves out every face that a surer one overlaps by more than ``at_most`` (of the union); surest first."""
    kept: list[DetectedFace] = []
    for face in sorted(faces, key=lambda own: -own.score):
        if all(overlap(face.box, other.box) <= at_most for other in kept):
            kept.append(face)
    return kept
