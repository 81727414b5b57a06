"""Boxes of a detector, refined and confirmed by what the network predicts in them.

The network was trained on crops around the box of the 68 landmarks, and the box of a detector differs from it by some
tenths. Therefore the maps of a first prediction are fitted, and the box around the landmarks of the fit is used for a
second one. Where there is no face, the maps fit no face either. This confirms or rejects doubtful candidates of a
detector.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.detectors.protocol import (
    SURE_SCORE,
    DetectedFace,
    Detector,
    overlap,
    sure_faces,
    without_doubles,
)
from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.face_fit import fit_face
from pix2face.geometry.camera import Camera, nearest_weak_perspective
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.maps import FaceMaps
from pix2face.inference.predictor import Prediction, Predictor
from pix2face.models.morphable_model import MorphableModel

# How well the maps of a crop fit a face: the median distance between a pixel and the projection of its own point, at
# the scale of the face. A network that has hardly been trained leaves 4 to 6 mm on faces and 6 to 20 mm elsewhere.
PLAUSIBLE_MM = 8.0
CONFIRMED_MM = 5.5
REFUTED_MM = 12.0
# How much of the face the network sees, where it says so: it finds a face in anything, but sees little of those that
# are not there. The limits are the packaged network's: set on a dozen photographs, and beyond what the 73 annotated
# faces of others have (seen by 0.62 at least, with 3.4 mm at most: tests.benchmarks.annotated). Of renders 10 of 35
# that are hidden by more than half are refuted.
CONFIRMED_SEEN, CONFIRMED_SEEN_MM = 0.7, 3.5
REFUTED_SEEN, REFUTED_UNSEEN_MM = 0.45, 2.5
# Overlap of the refined box with the detector's: a true one is corrected by little.
PLAUSIBLE_OVERLAP = 0.5
CONFIRMED_OVERLAP = 0.65
# Two detections whose refined boxes overlap by more are of one face.
SAME_FACE_OVERLAP = 0.4

RESIDUAL_PIXELS = 2000


@final
@dataclass(frozen=True)
class RefinedBox:
    """What a prediction says of a box.

    Attributes:
        box: Around the landmarks of the face that was fitted to the maps, pixels of the picture.
        residual_mm: How badly the maps fit a face; see above.
        overlap: Intersection over union with the box that the prediction was made in.
        seen_share: Visible share of the face; None if the network does not predict which part is visible.
    """

    box: FaceBox
    residual_mm: float
    overlap: float
    seen_share: float | None = None

    @property
    def is_plausible(self) -> bool:
        """Whether the refined box may be used instead of the first one."""
        return self.residual_mm <= PLAUSIBLE_MM and self.overlap >= PLAUSIBLE_OVERLAP

    @property
    def is_confirmed(self) -> bool:
        """Whether this is a face, even if its detection score is low."""
        if self.seen_share is None:
            fits = self.residual_mm <= CONFIRMED_MM
        else:
            fits = self.seen_share >= CONFIRMED_SEEN and self.residual_mm <= CONFIRMED_SEEN_MM
        return fits and self.overlap >= CONFIRMED_OVERLAP

    @property
    def is_refuted(self) -> bool:
        """Whether this is not a face, even if its detection score is high."""
        is_seen = self.seen_share is None or self.seen_share >= REFUTED_SEEN
        if not is_seen and self.residual_mm > REFUTED_UNSEEN_MM:
            return True
        return self.residual_mm > REFUTED_MM and self.overlap < PLAUSIBLE_OVERLAP


def refine_boxes(
    faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]], predictor: Predictor, model: MorphableModel
) -> list[FaceBox]:
    """The boxes of the landmarks of first predictions, or the given boxes where those are not plausible.

    Each face is a picture (RGB) and the detected box of a face in it, in pixels.
    """
    boxes = []
    for prediction, (_, box) in zip(predictor.predict_many(faces), faces, strict=True):
        better = refined_box(prediction, box, model)
        boxes.append(better.box if better is not None and better.is_plausible else box)
    return boxes


def refined_box(prediction: Prediction, box: FaceBox, model: MorphableModel) -> RefinedBox | None:
    """The refined box of a prediction; None if its maps determine no face."""
    try:
        fit = fit_face(prediction.maps, model)
        better = FaceBox.around(prediction.crop.to_image(fit.landmarks2d))
    except DegenerateGeometryError:
        return None
    residual_mm = _residual_px(prediction.maps, fit.camera) / nearest_weak_perspective(fit.camera).scale
    return RefinedBox(better, residual_mm, overlap(better, box), prediction.maps.seen_share)


def _residual_px(maps: FaceMaps, camera: Camera) -> float:
    """Median distance of the pixels from where the camera projects their own points."""
    rows, columns = np.nonzero(maps.mask)
    step = max(1, len(rows) // RESIDUAL_PIXELS)
    rows, columns = rows[::step], columns[::step]
    points3d = maps.pncc[rows, columns].astype(np.float64) + maps.offset[rows, columns]
    centres = np.column_stack([columns, rows]) + 0.5
    return float(np.median(np.linalg.norm(camera.project(points3d) - centres, axis=1)))


def confirm_faces(
    image: UInt8[ndarray, "h w 3"],
    candidates: Sequence[DetectedFace],
    predictor: Predictor,
    model: MorphableModel,
    sure_score: float = SURE_SCORE,
) -> list[DetectedFace]:
    """The candidates that are faces, with refined boxes, largest first.

    A candidate with a score of at least ``sure_score`` is kept unless the prediction rejects it. A candidate with a
    lower score is kept only if the prediction confirms it.
    """
    kept = []
    predictions = predictor.predict_many([(image, face.box) for face in candidates])
    for face, prediction in zip(candidates, predictions, strict=True):
        refined = refined_box(prediction, face.box, model)
        if refined is None or refined.is_refuted:
            continue
        if face.score >= sure_score or refined.is_confirmed:
            kept.append(DetectedFace(refined.box if refined.is_plausible else face.box, face.score))
    return sorted(without_doubles(kept, SAME_FACE_OVERLAP), key=lambda face: -face.box.longer_side)


def find_faces(
    image: UInt8[ndarray, "h w 3"],
    detector: Detector,
    predictor: Predictor,
    model: MorphableModel,
    min_score: float | None = None,
) -> list[DetectedFace]:
    """The faces of a picture (RGB), found by a detector, refined and confirmed by the network; largest first.

    With ``min_score``, these are the candidates with at least this score that the network does not reject. Without it,
    these are the candidates with a score of at least 1 that the network does not reject, and those with lower scores
    that it confirms.
    """
    return choose_faces(image, detector.candidates(image), predictor, model, min_score)


def choose_faces(
    image: UInt8[ndarray, "h w 3"],
    candidates: Sequence[DetectedFace],
    predictor: Predictor,
    model: MorphableModel,
    min_score: float | None = None,
) -> list[DetectedFace]:
    """As ``find_faces``, from the candidates that a detector has found."""
    if min_score is None:
        return confirm_faces(image, candidates, predictor, model)
    return confirm_faces(image, sure_faces(candidates, min_score), predictor, model, min_score)
