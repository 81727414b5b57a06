"""The class `Pix2Face`, which finds faces in photographs and fits maps, cameras, meshes and landmarks to them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.detectors import DEFAULT_DETECTOR, SURE_SCORE
from pix2face.detectors.detection import DetectedFace, Detector, open_detector
from pix2face.detectors.protocol import box_and_score, sure_faces
from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.fitting.face_fit import FaceFit, fit_face
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions
from pix2face.fitting.joint_fit import fit_joint
from pix2face.geometry.crops import image_centre_in_crop
from pix2face.inference import PACKAGED
from pix2face.inference.predictor import Prediction, Predictor
from pix2face.landmark_choice.landmark_file import with_own_landmarks
from pix2face.models import BUILTIN_MODEL
from pix2face.models.morphable_model import MorphableModel, open_model
from pix2face.photographs.given_photographs import (
    GivenBoxes,
    GivenPhotograph,
    as_boxes,
    as_photograph,
    as_photographs,
)
from pix2face.photographs.refined_detection import refine_faces


@final
class Pix2Face:
    """Dense 3D faces from photographs: a network, its morphable model and a face detector.

    It keeps nothing between calls. A photograph is a path, a PIL image, or an 8-bit RGB array as
    ``pix2face.files.images.read_photograph`` returns it. Paths and PIL images are turned upright by their orientation
    tag. A face box is a ``FaceBox`` or (left, top, right, bottom), tight around the 68 landmarks. Pixels are (x, y)
    with centres at +0.5. Millimetres are those of the model frame (docs/reference/conventions.md).

    Args:
        predictor: The network.
        model: The morphable model that the network was trained for; None if only maps are wanted.
        detector: The face detector; None uses the default of ``pix2face.detectors.detection``.
        refine: Whether a first prediction corrects or rejects the detector's boxes; needs the model.
        min_score: Smallest score of a detected face.

    Raises:
        ModelMismatchError: The network was trained for another model.
    """

    def __init__(
        self,
        predictor: Predictor,
        model: MorphableModel | None,
        detector: Detector | None = None,
        refine: bool = True,
        *,
        min_score: float = SURE_SCORE,
    ) -> None:
        if model is not None:
            predictor.header.check_model(model.name, model.sha256)
        self.predictor = predictor
        self._model = model
        self._detector = detector
        self._refine = refine
        self._min_score = min_score

    @property
    def model(self) -> MorphableModel:
        """The morphable model.

        Raises:
            UsageError: There is none.
        """
        if self._model is None:
            raise UsageError("expected a morphable model to fit, found none; name one when loading Pix2Face")
        return self._model

    @classmethod
    def load(
        cls,
        checkpoint: Path | str | None = None,
        model: MorphableModel | Path | str | None = BUILTIN_MODEL,
        device: str | None = None,
        detector: str = DEFAULT_DETECTOR,
        refine: bool = True,
        *,
        own_landmarks: bool | None = None,
        min_score: float = SURE_SCORE,
        smallest_face: float | None = None,
    ) -> "Pix2Face":
        """Opens a checkpoint and the model that it was trained for.

        Args:
            checkpoint: Checkpoint of a training; None uses the packaged one.
            model: ``builtin``, the path of a model file, or a model; None if only maps are wanted.
            device: "cpu", or the name of a device of PyTorch; None uses a GPU if there is one and PyTorch is installed.
            detector: Name or file of a face detector, as ``pix2face.detectors.detection.open_detector`` takes it.
            refine: As in the class.
            own_landmarks: Whether the landmarks in the checkpoint replace those of the model. None means True, unless
                ``model`` is a ``MorphableModel``.
            min_score: As in the class.
            smallest_face: Longer side of the smallest faces to be found, as a share of the photograph's longer side;
                None uses the detector's default (``pix2face.detectors.detection.open_detector``).

        Raises:
            InputFileError: The checkpoint or the model is missing, truncated, foreign, or of a newer schema.
            ModelMismatchError: The checkpoint was trained for another model.
            UsageError: No checkpoint was named, and the package has none; there is no such detector or device; or the
                smallest face is not a share.
        """
        path = PACKAGED if checkpoint is None else Path(checkpoint)
        predictor = Predictor.load(path, device)
        opened = open_model(str(model)) if isinstance(model, str | Path) else model
        if opened is not None and (opened is not model if own_landmarks is None else own_landmarks):
            opened = with_own_landmarks(opened, predictor.header)
        return cls(predictor, opened, open_detector(detector, smallest_face), refine, min_score=min_score)

    def find_faces(self, image: GivenPhotograph) -> list[DetectedFace]:
        """Finds the faces in a photograph: their boxes and scores, largest first; empty if there is none.

        A photograph may lie on its side or be upside down, except for the detector of dlib.

        Raises:
            InputFileError: The photograph's file is missing, or cannot be decoded.
            UsageError: The photograph is neither a path, nor a PIL image, nor an 8-bit RGB array.
        """
        image = as_photograph(image)
        detector = self._detector or open_detector()
        faces = sure_faces(detector.candidates(image), self._min_score)
        if self._refine and self._model is not None:
            return refine_faces(image, faces, self.predictor, self._model)
        return faces

    def predict(self, image: GivenPhotograph, boxes: GivenBoxes | None = None) -> list[Prediction]:
        """Predicts the maps of every face in a photograph.

        Args:
            image: The photograph.
            boxes: Boxes of the faces; None detects them.

        Returns:
            One prediction for each box, in the same order; empty if there is no face.

        Raises:
            DegenerateGeometryError: A box has no extent, or the network's output is not finite.
            InputFileError: As ``find_faces``.
            UsageError: As ``find_faces``, or a box is not four numbers.
        """
        return self.predict_batch([image], None if boxes is None else [boxes])[0]

    def predict_batch(
        self, images: Sequence[GivenPhotograph], boxes: Sequence[GivenBoxes] | None = None
    ) -> list[list[Prediction]]:
        """Predicts the maps of every face in several photographs of any sizes, many faces at once.

        Args:
            images: The photographs.
            boxes: For each photograph as in ``predict``.

        Raises:
            DegenerateGeometryError: As ``predict``.
            InputFileError: As ``find_faces``.
            UsageError: As ``predict``, or photographs and lists of boxes differ in number.
        """
        photographs = as_photographs(images)
        if boxes is None:
            boxes = [self.find_faces(image) for image in photographs]
        if len(boxes) != len(photographs):
            raise UsageError(
                f"expected boxes for each of {len(photographs)} photographs, found {len(boxes)} lists of boxes"
            )
        boxes_of = [as_boxes(own) for own in boxes]
        faces = [(image, *box_and_score(box)) for image, own in zip(photographs, boxes_of, strict=True) for box in own]
        found = self.predictor.predict_many([(image, box) for image, box, _ in faces])
        for prediction in found:
            prediction.check_finite()
        predictions = [replace(own, score=score) for own, (_, _, score) in zip(found, faces, strict=True)]
        ends = np.cumsum([len(own) for own in boxes_of]).tolist()
        return [predictions[end - len(own) : end] for end, own in zip(ends, boxes_of, strict=True)]

    def fit(
        self,
        image: GivenPhotograph,
        boxes: GivenBoxes | None = None,
        options: FitOptions = DEFAULT_FIT,
    ) -> list[FaceFit]:
        """Fits camera, coefficients, mesh and landmarks to every face in a photograph, in its pixels.

        Args:
            image: The photograph.
            boxes: As in ``predict``.
            options: Camera, regularisation and so on.

        Raises:
            DegenerateGeometryError: As ``predict``, or the maps of a face do not determine it.
            InputFileError: As ``find_faces``.
            UsageError: As ``predict``, or there is no morphable model.
        """
        image = as_photograph(image)
        height, width = image.shape[:2]
        return [self.fit_prediction(prediction, (height, width), options) for prediction in self.predict(image, boxes)]

    def fit_prediction(
        self,
        prediction: Prediction,
        image_size_px: tuple[int, int],
        options: FitOptions = DEFAULT_FIT,
    ) -> FaceFit:
        """Fits a face as ``fit`` does, to maps that were predicted before.

        Args:
            prediction: The prediction for one face.
            image_size_px: Height and width of the photograph.
            options: As in ``fit``.

        Raises:
            DegenerateGeometryError: The maps do not determine camera and coefficients, or are not finite.
        """
        prediction.check_finite()
        principal_point = image_centre_in_crop(prediction.crop, image_size_px)
        fitted = fit_face(prediction.maps, self.model, options, principal_point_px=principal_point)
        return _in_photograph(fitted, prediction)

    def fit_joint(
        self,
        images: Sequence[GivenPhotograph],
        boxes: GivenBoxes | None = None,
        options: FitOptions = DEFAULT_FIT,
    ) -> list[FaceFit]:
        """Fits photographs of one person: one identity, and for each photograph its camera and expression (Eq. 5).

        Args:
            images: The photographs, each showing the person.
            boxes: Box of the person in each photograph; None uses the largest face.
            options: As in ``fit``.

        Returns:
            One fit for each photograph, in its pixels; all have the same identity.

        Raises:
            DegenerateGeometryError: As ``fit``, or no face is found in a photograph.
            InputFileError: As ``find_faces``.
            UsageError: As ``predict_batch``, or there is no morphable model.
        """
        photographs = as_photographs(images)
        if boxes is None:
            boxes = [self._largest_face(image, index) for index, image in enumerate(photographs)]
        predictions = [prediction for (prediction,) in self.predict_batch(photographs, [[box] for box in boxes])]
        sizes = [(image.shape[0], image.shape[1]) for image in photographs]
        return self.fit_predictions_joint(predictions, sizes, options)

    def fit_predictions_joint(
        self,
        predictions: Sequence[Prediction],
        image_sizes_px: Sequence[tuple[int, int]],
        options: FitOptions = DEFAULT_FIT,
    ) -> list[FaceFit]:
        """Fits photographs as ``fit_joint`` does, to maps that were predicted before.

        Args:
            predictions: The prediction for one face in each photograph.
            image_sizes_px: Height and width of each photograph.
            options: As in ``fit``.

        Raises:
            DegenerateGeometryError: As ``fit_prediction``, or there is no photograph.
        """
        for prediction in predictions:
            prediction.check_finite()
        principal_points = [
            image_centre_in_crop(prediction.crop, size)
            for prediction, size in zip(predictions, image_sizes_px, strict=True)
        ]
        fits = fit_joint(
            (prediction.maps for prediction in predictions), self.model, options, principal_points_px=principal_points
        )
        return [_in_photograph(fit, prediction) for fit, prediction in zip(fits, predictions, strict=True)]

    def _largest_face(self, image: UInt8[ndarray, "h w 3"], index: int) -> DetectedFace:
        boxes = self.find_faces(image)
        if not boxes:
            raise DegenerateGeometryError(f"no face found in photograph {index} (from 0); say where it is with boxes")
        return boxes[0]


def _in_photograph(fitted: FaceFit, prediction: Prediction) -> FaceFit:
    """Returns a fit in pixels of the photograph, with the box and the score of the face."""
    return replace(fitted.in_image(prediction.crop), box=prediction.box, score=prediction.score)
