"""Boxes of a detector, refined by what the network predicts in them.

The network was trained on crops around the box of the 68 landmarks, and a detector hits that box within some tenths. So
the box of the landmarks of a first prediction is used for a second one: of those that the network predicts itself, or
else of those of a fit to its maps. Where there is no face, the network expects large errors, or its maps fit no face,
which removes nearly all false boxes (figures: docs/explanation/detection_and_tracking.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.detectors.protocol import DetectedFace, overlap, without_doubles
from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.face_fit import expected_distances, expected_error, fit_face
from pix2face.fitting.picture_measurement import LEAST_PIXELS
from pix2face.geometry.camera import Camera, nearest_weak_perspective
from pix2face.geometry.crops import Crop, FaceBox
from pix2face.geometry.maps import FaceMaps, PredictedLandmarks
from pix2face.inference.predictor import Prediction, Predictor
from pix2face.models.morphable_model import MorphableModel

# Error that the network expects (``FaceFit.expected_error``). It was chosen on AFLW2000-3D's 400 photographs and dlib's
# nine: the network expects more for five of 440 faces, and less for no false box that does not show a face.
PLAUSIBLE_ERROR = 0.087
# For boxes of turned pictures: a picture without faces has eight chances to look like one.
PLAUSIBLE_ERROR_IF_TURNED = 0.045
# For networks that expect no errors, how well the maps of a crop fit a face: the median distance between a pixel and
# the projection of its own point, at the scale of the face. A good network leaves 2 mm on most faces, and one that has
# hardly been trained leaves 10 mm and more.
PLAUSIBLE_MM = 6.0
# Overlap of the refined box with the detector's: a true one is corrected by little.
PLAUSIBLE_OVERLAP = 0.4
# Two detections whose refined boxes overlap by more are of one face.
SAME_FACE_OVERLAP = 0.4

RESIDUAL_PIXELS = 2000


@final
@dataclass(frozen=True)
class RefinedBox:
    """What a first prediction says of a box.

    Attributes:
        box: Around the landmarks of the prediction, pixels of the picture.
        overlap: Intersection over union with the box that the prediction was made in.
        expected_error: Error that the network expects (``FaceFit.expected_error``); None if it does not predict it.
        residual_mm: How badly the maps fit a face, see above; None if it is not needed.
        can_refute: Whether the network can tell that there is no face: if it says where faces are seen, or how wrong it
            is. Other networks cannot, and the detector decides.
    """

    box: FaceBox
    overlap: float
    expected_error: float | None = None
    residual_mm: float | None = None
    can_refute: bool = True

    @property
    def is_plausible(self) -> bool:
        """Whether there is a face in this place, so that the refined box may be used."""
        largest_error = PLAUSIBLE_ERROR_IF_TURNED if self.box.turn_deg else PLAUSIBLE_ERROR
        is_error_small = self.expected_error is None or self.expected_error <= largest_error
        is_residual_small = self.residual_mm is None or self.residual_mm <= PLAUSIBLE_MM
        return is_error_small and is_residual_small and self.overlap >= PLAUSIBLE_OVERLAP

    @property
    def is_refuted(self) -> bool:
        """Whether there is no face."""
        return self.can_refute and not self.is_plausible


def refine_boxes(
    faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]], predictor: Predictor, model: MorphableModel
) -> list[FaceBox]:
    """The boxes of the landmarks of first predictions, or the given boxes where those are not plausible.

    Each face is a picture (RGB) and the detected box of a face in it, in pixels.
    """
    refined = refined_boxes(faces, predictor, model)
    return [
        box if better is None or not better.is_plausible else better.box
        for better, (_, box) in zip(refined, faces, strict=True)
    ]


def refined_boxes(
    faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]], predictor: Predictor, model: MorphableModel
) -> list[RefinedBox | None]:
    """What first predictions say of boxes, which are given as for ``refine_boxes``; None where there is no face."""
    if predictor.header.n_landmarks:
        found = [
            _around_landmarks(crop, landmarks, box)
            for (crop, landmarks), (_, box) in zip(predictor.predict_landmarks(faces), faces, strict=True)
        ]
        # A face that is tilted in another way than its box says is not plausible at first. A whole prediction, which is
        # not told the turn of the box, looks at it upright.
        doubtful = [place for place, own in enumerate(found) if own is None or not own.is_plausible]
        untold = [(faces[place][0], replace(faces[place][1], turn_deg=0.0)) for place in doubtful]
        for place, prediction in zip(doubtful, predictor.predict_many(untold), strict=True):
            assert prediction.maps.landmarks is not None
            found[place] = _around_landmarks(prediction.crop, prediction.maps.landmarks, prediction.box)
        return found
    return [
        _around_fit(prediction, box, model)
        for prediction, (_, box) in zip(predictor.predict_many(faces), faces, strict=True)
    ]


def _around_landmarks(crop: Crop, landmarks: PredictedLandmarks, box: FaceBox) -> RefinedBox | None:
    try:
        better = replace(FaceBox.around(crop.to_image(landmarks.points2d)), turn_deg=box.turn_deg)
    except DegenerateGeometryError:
        return None
    error = expected_error(landmarks.points2d, expected_distances(landmarks))
    return RefinedBox(better, overlap(better, box), expected_error=error)


def _around_fit(prediction: Prediction, box: FaceBox, model: MorphableModel) -> RefinedBox | None:
    maps = prediction.maps
    if maps.mask.sum() < LEAST_PIXELS:
        return None
    try:
        fit = fit_face(maps, model)
        better = replace(FaceBox.around(prediction.crop.to_image(fit.landmarks2d)), turn_deg=box.turn_deg)
    except DegenerateGeometryError:
        return None
    residual_mm = _residual_px(maps, fit.camera) / nearest_weak_perspective(fit.camera).scale
    return RefinedBox(better, overlap(better, box), residual_mm=residual_mm, can_refute=maps.seen is not None)


def _residual_px(maps: FaceMaps, camera: Camera) -> float:
    """Median distance of the pixels from where the camera projects their own points."""
    rows, columns = np.nonzero(maps.mask)
    step = max(1, len(rows) // RESIDUAL_PIXELS)
    rows, columns = rows[::step], columns[::step]
    points3d = maps.pncc[rows, columns].astype(np.float64) + maps.offset[rows, columns]
    centres = np.column_stack([columns, rows]) + 0.5
    return float(np.median(np.linalg.norm(camera.project(points3d) - centres, axis=1)))


def refine_faces(
    image: UInt8[ndarray, "h w 3"], faces: Sequence[DetectedFace], predictor: Predictor, model: MorphableModel
) -> list[DetectedFace]:
    """The faces that a detector found in a picture (RGB), with refined boxes, largest first.

    Left out are those that a network rejects that can tell, and all but the surest of those that turn out to be one.
    """
    kept = []
    found = refined_boxes([(image, face.box) for face in faces], predictor, model)
    for face, refined in zip(faces, found, strict=True):
        if refined is not None and not refined.is_refuted:
            kept.append(DetectedFace(refined.box if refined.is_plausible else face.box, face.score))
    return sorted(without_doubles(kept, SAME_FACE_OVERLAP), key=lambda face: -face.box.longer_side)
