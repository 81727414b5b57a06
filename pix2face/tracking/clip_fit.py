"""Fits of the frames of a clip: one identity, and a camera and an expression for each frame."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar, final

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray
from scipy.linalg import cho_solve

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.face_fit import FaceFit, face_of_coefficients
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions
from pix2face.fitting.least_squares.linear_system import cholesky
from pix2face.fitting.picture_measurement import PictureMeasurement, measure_picture
from pix2face.geometry.camera import Camera, WeakPerspective, nearest_weak_perspective, weak_perspective_camera
from pix2face.geometry.crops import Crop, FaceBox, image_centre_in_crop
from pix2face.geometry.landmarks import OUTER_EYE_CORNERS
from pix2face.geometry.maps import PredictedLandmarks
from pix2face.inference.predictor import Prediction, Predictor
from pix2face.models.morphable_model import MorphableModel
from pix2face.photographs.refined_detection import refine_boxes
from pix2face.tracking.ahead import ahead

Photograph = UInt8[ndarray, "_ _ 3"]
Key = TypeVar("Key")


@final
@dataclass(frozen=True, eq=False)
class FaceView:
    """A face in one frame without its coefficients."""

    camera: Camera  # pixels of the crop
    crop: Crop  # where the crop lies in the frame
    seen_share: float | None  # visible share of the face; None if the network does not predict it
    landmarks: PredictedLandmarks | None  # None if the network does not predict them


@final
@dataclass(frozen=True, eq=False)
class MeasuredFace:
    """A face in one frame before its coefficients are computed."""

    measurement: PictureMeasurement  # camera (pixels of the crop) and linear system of the coefficients
    view: FaceView


@final
@dataclass(frozen=True, eq=False)
class SettledFace:
    """A face in one frame, fitted with the identity of the clip."""

    fit: FaceFit  # pixels of the frame
    seen_share: float | None  # as in ``FaceView``


@final
@dataclass(frozen=True, eq=False)
class FrameFitter:
    """Fits the frames of a clip."""

    predictor: Predictor
    model: MorphableModel  # that of the network
    options: FitOptions = DEFAULT_FIT
    refine: bool = True  # whether a first prediction refines each box

    def measure_each(
        self, groups: Iterable[tuple[Key, Sequence[tuple[Photograph, FaceBox]]]]
    ) -> Iterator[tuple[Key, list[MeasuredFace | None]]]:
        """Predicts and measures groups of faces, and yields each group's key with them; None if maps show no face.

        While a group is measured, a thread refines the boxes of the next.

        Raises:
            DegenerateGeometryError: The network's output is not finite.
        """
        for key, faces in ahead(((key, self._refined(faces)) for key, faces in groups), 1):
            predictions = self.predictor.predict_many(faces)
            yield key, [self._measured(own, image) for own, (image, _) in zip(predictions, faces, strict=True)]

    def _refined(self, faces: Sequence[tuple[Photograph, FaceBox]]) -> list[tuple[Photograph, FaceBox]]:
        if not self.refine:
            return list(faces)
        boxes = refine_boxes(faces, self.predictor, self.model)
        return [(image, box) for (image, _), box in zip(faces, boxes, strict=True)]

    def _measured(self, prediction: Prediction, image: Photograph) -> MeasuredFace | None:
        prediction.check_finite()
        middle = image_centre_in_crop(prediction.crop, (image.shape[0], image.shape[1]))
        try:
            measurement = measure_picture(prediction.maps, self.model, self.options, principal_point_px=middle)
        except DegenerateGeometryError:
            return None
        maps = prediction.maps
        view = FaceView(measurement.camera, prediction.crop, maps.seen_share, maps.landmarks)
        return MeasuredFace(measurement, view)

    def settled(self, face: MeasuredFace, identity: Float64[ndarray, " k"]) -> SettledFace:
        """Fits the expression of a measured face to a given identity.

        Raises:
            DegenerateGeometryError: lambda is too small for the arithmetic.
        """
        expression = expression_of(face.measurement, identity)
        return self.fit(face.view, identity, expression)

    def fit(self, view: FaceView, identity: Float64[ndarray, " k"], expression: Float64[ndarray, " e"]) -> SettledFace:
        """Returns the face with the given coefficients, in pixels of the frame."""
        fit = face_of_coefficients(
            self.model, view.camera, identity, expression, landmark_type=self.options.landmark_type
        )
        return SettledFace(fit.with_errors_of(view.landmarks).in_image(view.crop), view.seen_share)

    def placed(self, box: FaceBox, identity: Float64[ndarray, " k"]) -> FaceFit:
        """Returns the neutral face of an identity, frontal and upright, with its landmarks in the box."""
        frontal = weak_perspective_camera(WeakPerspective(1.0, np.diag([1.0, -1.0, -1.0]), np.zeros(2)))
        expression = np.zeros(self.model.n_expression)
        own = FaceBox.around(face_of_coefficients(self.model, frontal, identity, expression).landmarks2d)
        return face_of_coefficients(self.model, frontal.transformed(box_to_box(own, box)), identity, expression)


def expression_of(measurement: PictureMeasurement, identity: Float64[ndarray, " k"]) -> Float64[ndarray, " e"]:
    """Solves Eq. 5 for the expression of a frame, in standard deviations, with the identity given.

    Raises:
        DegenerateGeometryError: lambda is too small for the arithmetic.
    """
    k = len(identity)
    system, regularisation = measurement.system, measurement.regularisation
    normal = system.normal.astype(np.float64)
    right = system.right[k:] - normal[k:, :k] @ identity
    if len(right) == 0:
        return np.zeros(0)
    factor = cholesky(normal[k:, k:] + regularisation * np.eye(len(right)), regularisation)
    return np.asarray(cho_solve(factor, right), dtype=np.float64)


def box_to_box(first: FaceBox, second: FaceBox) -> Float64[ndarray, "3 3"]:
    """Returns the scaling and translation of pixels that map the first box's centre and longer side to the second's."""
    scale = second.longer_side / first.longer_side
    matrix = np.diag([scale, scale, 1.0])
    matrix[:2, 2] = second.centre - scale * first.centre
    return matrix


def eye_distance_px(fit: FaceFit) -> float:
    """Returns the 3D distance of the outer eye corners times the camera's scale. It does not depend on the pose."""
    right, left = (fit.landmarks3d[index] for index in OUTER_EYE_CORNERS)
    return float(np.linalg.norm(left - right)) * nearest_weak_perspective(fit.camera).scale
