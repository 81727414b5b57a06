"""The subjects of evaluations: a network with a fit, another system's file, or the model fitted to the truth."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, final, runtime_checkable

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace
from pix2face.evaluation.figures.detection_summary import FaceDetection
from pix2face.evaluation.subjects.predictions_file import Predictions
from pix2face.fitting.face_fit import FaceFit, face_of_coefficients, fit_face
from pix2face.fitting.fit_options import DEFAULT_FIT, EXACT_MAPS_REGULARISATION, FitOptions
from pix2face.fitting.from_landmarks import LandmarkModel, fit_landmarks
from pix2face.fitting.jaw_contour import JawContour
from pix2face.geometry.camera import Camera, head_pose, nearest_weak_perspective
from pix2face.geometry.crops import Crop, FaceBox, image_centre_in_crop
from pix2face.geometry.maps import FaceMaps
from pix2face.inference.predictor import Prediction
from pix2face.models.morphable_model import MorphableModel


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class FoundFace:
    """What a subject found for one face."""

    landmarks2d: Float64[ndarray, "68 2"] | None  # image pixels; None where it found nothing
    failure: str | None = None  # why it found nothing
    landmarks3d: Float64[ndarray, "68 3"] | None = None  # in the subject's own unit and axes
    z_px: Float64[ndarray, "68"] | None = None  # of the landmarks in the picture, towards the viewer, up to a constant
    pose_deg: Float64[ndarray, "3"] | None = None  # pitch, yaw, roll with the signs of 300W-LP
    maps: FaceMaps | None = None  # in the pixels of the crop
    crop: Crop | None = None
    identity: Float64[ndarray, " k"] | None = None  # standard deviations
    expression: Float64[ndarray, " e"] | None = None  # standard deviations
    detection: FaceDetection | None = None  # where a detector looked for the face


@runtime_checkable
class Subject(Protocol):
    """Something that finds landmarks and can be measured."""

    @property
    def method(self) -> str:
        """Its name in tables, one word."""

    @property
    def needs_images(self) -> bool:
        """Whether it looks at pictures."""

    def find(self, faces: Sequence[BenchmarkFace]) -> list[FoundFace]:
        """Finds some faces; the results are in their order."""


@runtime_checkable
class MapPredictor(Protocol):
    """Predicts maps from pictures."""

    def predict_batch(self, faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]]) -> Sequence[Prediction]:
        """Maps of the faces in boxes."""


# Fits a face to maps; the second argument is the centre of the image in them (the principal point of a pinhole).
Fit = Callable[[FaceMaps, Float64[ndarray, "2"]], FaceFit]
# Looks for a face with a detector.
Detect = Callable[[BenchmarkFace], FaceDetection]

# For benchmarks that state poses in the frame of the model that is fitted.
OWN_FRAME = np.eye(3)


@final
@dataclass(frozen=True, eq=False)
class NetworkSubject:
    """A network and a fit to its maps."""

    predictor: MapPredictor
    fit: Fit  # raises DegenerateGeometryError where the maps hold no face
    detect: Detect | None = None  # None looks at the true box
    model_from_stated: Float64[ndarray, "3 3"] = field(default_factory=OWN_FRAME.copy)  # see `pose_of`
    method = "network"
    needs_images = True

    def find(self, faces: Sequence[BenchmarkFace]) -> list[FoundFace]:
        """Predicts the maps of all faces in one pass and fits each."""
        detections = [None if self.detect is None else self.detect(face) for face in faces]
        wanted: dict[int, tuple[UInt8[ndarray, "h w 3"], FaceBox]] = {}
        for index, (face, detection) in enumerate(zip(faces, detections, strict=True)):
            image = face.with_image().image
            # The tight box of the true landmarks, as the benchmarks prescribe.
            box = FaceBox.around(face.landmarks2d) if detection is None else detection.box
            assert image is not None
            if box is not None:
                wanted[index] = image, box
        predictions = self.predictor.predict_batch(list(wanted.values())) if wanted else []
        found = {
            index: self._fitted(prediction, image)
            for (index, (image, _)), prediction in zip(wanted.items(), predictions, strict=True)
        }
        return [
            replace(found[index], detection=detection) if index in found else _not_detected(detection)
            for index, detection in enumerate(detections)
        ]

    def _fitted(self, prediction: Prediction, image: UInt8[ndarray, "h w 3"]) -> FoundFace:
        image_centre = image_centre_in_crop(prediction.crop, (image.shape[0], image.shape[1]))
        try:
            prediction.check_finite()
            fitted = self.fit(prediction.maps, image_centre).in_image(prediction.crop)
        except DegenerateGeometryError as error:
            return FoundFace(landmarks2d=None, failure=str(error), maps=prediction.maps, crop=prediction.crop)
        return _found(fitted, self.model_from_stated, prediction)


@final
@dataclass(frozen=True, eq=False)
class PredictionsSubject:
    """Landmarks that another system wrote to a file."""

    predicted: Predictions
    row_of_name: Mapping[str, int]  # the row of each face of the benchmark that is in the file
    method = "predictions"
    needs_images = False

    def find(self, faces: Sequence[BenchmarkFace]) -> list[FoundFace]:
        """Looks the faces up."""
        return [self._row(self.row_of_name.get(face.name)) for face in faces]

    def _row(self, row: int | None) -> FoundFace:
        if row is None:
            return FoundFace(landmarks2d=None, failure=f"absent from {self.predicted.source.name}")
        landmarks2d = self.predicted.landmarks2d[row]
        if not np.isfinite(landmarks2d).all():
            return FoundFace(landmarks2d=None, failure=f"NaN or infinity in {self.predicted.source.name}")
        points3d, poses = self.predicted.landmarks3d, self.predicted.pose_deg
        pose = None if poses is None or not np.isfinite(poses[row]).all() else poses[row]
        return FoundFace(
            landmarks2d=landmarks2d,
            landmarks3d=None if points3d is None else points3d[row],
            z_px=None if self.predicted.z_px is None else self.predicted.z_px[row],
            pose_deg=pose,
        )


@final
@dataclass(frozen=True, eq=False)
class OracleSubject:
    """The model fitted to the truth itself: a bound for every network, set by the model and the fit.

    The fit is to true maps where the truth has them, else to true landmarks.
    """

    model: MorphableModel
    options: FitOptions = DEFAULT_FIT  # of them the type of landmarks, and the camera for maps
    model_from_stated: Float64[ndarray, "3 3"] = field(default_factory=OWN_FRAME.copy)  # see `pose_of`
    method = "oracle"
    needs_images = False

    @cached_property
    def _points(self) -> tuple[LandmarkModel, JawContour | None]:
        if self.options.landmark_type == "2d":
            return LandmarkModel.marked(self.model), JawContour.of(self.model)
        return LandmarkModel.of(self.model), None

    def find(self, faces: Sequence[BenchmarkFace]) -> list[FoundFace]:
        """Fits each face."""
        return [self._fit(face) for face in faces]

    def _fit(self, face: BenchmarkFace) -> FoundFace:
        try:
            if face.maps is not None:
                exactly = replace(self.options, regularisation=EXACT_MAPS_REGULARISATION, silhouette=False)
                return _found(fit_face(face.maps, self.model, exactly), self.model_from_stated)
            model, contour = self._points
            fitted = fit_landmarks(model, face.landmarks2d, contour=contour)
        except DegenerateGeometryError as error:
            return FoundFace(landmarks2d=None, failure=str(error))
        found = face_of_coefficients(self.model, fitted.camera, fitted.identity, fitted.expression)
        return FoundFace(
            landmarks2d=fitted.matched2d,
            landmarks3d=found.landmarks3d,
            z_px=z_in_picture(fitted.camera, found.landmarks3d),
            pose_deg=pose_of(fitted.camera, self.model_from_stated),
            identity=fitted.identity,
            expression=fitted.expression,
        )


def pose_of(camera: Camera, model_from_stated: Float64[ndarray, "3 3"] = OWN_FRAME) -> Float64[ndarray, "3"]:
    """Pitch, yaw, roll in degrees with the signs of 300W-LP, of a camera from the model frame to any pixels.

    The rotation leads to the model frame from the frame in which the pose is stated.
    """
    turn = np.eye(4)
    turn[:3, :3] = model_from_stated
    pose = head_pose(Camera(camera.matrix @ turn))
    return np.array([pose.pitch_deg, pose.yaw_deg, pose.roll_deg])


def z_in_picture(camera: Camera, points3d: Float64[ndarray, "n 3"]) -> Float64[ndarray, " n"]:
    """How near model points are to the viewer, in pixels of the picture, up to a constant: z of ``pt3d_68``."""
    return -nearest_weak_perspective(camera).scale * camera.depth(points3d)


def _not_detected(detection: FaceDetection | None) -> FoundFace:
    elsewhere = 0 if detection is None else detection.n_false
    failure = f"the detector found {elsewhere} elsewhere" if elsewhere else "the detector found no face"
    return FoundFace(landmarks2d=None, failure=failure, detection=detection)


def _found(
    fitted: FaceFit, model_from_stated: Float64[ndarray, "3 3"], prediction: Prediction | None = None
) -> FoundFace:
    return FoundFace(
        landmarks2d=fitted.landmarks2d,
        landmarks3d=fitted.landmarks3d,
        z_px=z_in_picture(fitted.camera, fitted.landmarks3d),
        pose_deg=pose_of(fitted.camera, model_from_stated),
        maps=None if prediction is None else prediction.maps,
        crop=None if prediction is None else prediction.crop,
        identity=fitted.identity,
        expression=fitted.expression,
    )
