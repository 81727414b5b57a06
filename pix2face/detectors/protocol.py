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


def box_of_window(centre_px: tuple[float, float], side_px: float, calibration: "WindowCalibration") -> FaceBox:
    """Converts a detector's square window to the box of the landmarks.

    Args:
        centre_px: Centre (x, y) of the window, pixel centres at +0.5.
        side_px: Side of the window.
        calibration: The detector's calibration.
    """
    right, below = calibration.shift
    x, y = centre_px[0] + right * side_px, centre_px[1] + below * side_px
    half_width, half_height = calibration.width * side_px / 2, calibration.height * side_px / 2
    return FaceBox(float(x - half_width), float(y - half_height), float(x + half_width), float(y + half_height))


@final
@dataclass(frozen=True)
class WindowCalibration:
    """Where the tight box of the 68 landmarks lies in a detector's square window; all values are fractions of its side.

    Attributes:
        shift: From the centre of the window to the centre of the box, (right, down).
        width: Width of the box.
        height: Height of the box.
    """

    shift: tuple[float, float]
    width: float
    height: float


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
