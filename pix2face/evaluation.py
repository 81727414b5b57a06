"""A benchmark through a predictor and a fit: one result a face, and the trivial baseline beside it.

Predictor and fit are passed in. A face whose fit fails stays in the figures with the error infinity; a face whose files
are damaged is listed and left out.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

import numpy as np
from jaxtyping import Float, Float64, UInt8
from numpy import ndarray

from pix2face.benchmark_data import BenchmarkFace, BenchmarkItem, Unreadable
from pix2face.crops import Crop, FaceBox
from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.face_maps import FaceMaps
from pix2face.jitter import crop_maps
from pix2face.landmarks import IBUG68
from pix2face.metrics import POINT_SETS, Normaliser, nme
from pix2face.morphable_model import MorphableModel


@runtime_checkable
class PredictedMaps(Protocol):
    """Maps in the pixels of a crop."""

    @property
    def maps(self) -> FaceMaps:
        """The maps."""

    @property
    def crop(self) -> Crop:
        """Where they lie in the image."""


@runtime_checkable
class MapPredictor(Protocol):
    """Predicts maps from a picture."""

    def predict(self, image: UInt8[ndarray, "h w 3"], box: FaceBox) -> PredictedMaps:
        """Maps of the face in a box."""


@runtime_checkable
class FittedFace(Protocol):
    """A fit, of which the evaluation wants the landmarks."""

    @property
    def landmarks2d(self) -> Float[ndarray, "68 2"]:
        """Projected landmarks in the pixels that were fitted."""

    def in_image(self, crop: Crop) -> "FittedFace":
        """The same in the pixels of the image that the crop was taken from."""


# From maps, and where the image's centre lies in them (the principal point of a pinhole), to a fitted face.
Fit = Callable[[FaceMaps, Float64[ndarray, "2"]], FittedFace]


@final
@dataclass(frozen=True)
class MapErrors:
    """How far predicted maps are from the true ones, over the pixels of the crop that both call face.

    Attributes:
        pncc_mm: Mean distance; None where no pixel is common.
        offset_mm: Mean distance.
        offset_baseline_mm: Mean length of the true offset: the error of predicting none.
        mask_iou: Pixels that both call face over pixels that either does.
    """

    pncc_mm: float | None
    offset_mm: float | None
    offset_baseline_mm: float | None
    mask_iou: float


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class FaceResult:
    """What came out for one face.

    Attributes:
        name: What lists call it.
        group: The column of the table that it counts in.
        yaw_deg: True yaw, where known.
        has_unusual_angle: Whether an angle of the truth is beyond ±99°.
        errors: For each point set ("68", "51") the error; infinity where the fit failed.
        baseline: The same for the mean face placed in the box.
        landmarks2d: Fitted landmarks in image pixels; None where the fit failed.
        failure: Why there is no fit, or None.
        maps: Errors of the maps, where the truth knows them.
    """

    name: str
    group: str
    yaw_deg: float | None
    has_unusual_angle: bool
    errors: Mapping[str, float]
    baseline: Mapping[str, float]
    landmarks2d: Float64[ndarray, "68 2"] | None
    failure: str | None
    maps: MapErrors | None


@final
@dataclass(frozen=True)
class Evaluator:
    """Everything that one evaluation holds fixed.

    Attributes:
        model: Its mean face is the baseline.
        predictor: Picture and box to maps.
        fit: Maps to a fitted face; raises DegenerateGeometryError where they hold none.
        normaliser: What errors are divided by.
    """

    model: MorphableModel
    predictor: MapPredictor
    fit: Fit
    normaliser: Normaliser

    def evaluate(self, face: BenchmarkFace) -> FaceResult:
        """Predicts, fits and measures one face in the tight box of its true landmarks.

        Raises:
            DegenerateGeometryError: The true landmarks have no extent.
        """
        box = FaceBox.around(face.landmarks2d)
        prediction = self.predictor.predict(face.image, box)
        landmarks2d, failure = self._fit(prediction, face.image)
        fitted = np.full((68, 2), np.nan) if landmarks2d is None else landmarks2d
        return FaceResult(
            name=face.name,
            group=face.group,
            yaw_deg=face.yaw_deg,
            has_unusual_angle=face.has_unusual_angle,
            errors=self._errors(fitted, face),
            baseline=self._errors(mean_face_in_box(self.model, box), face),
            landmarks2d=landmarks2d,
            failure=failure,
            maps=None if face.maps is None else compare_maps(prediction.maps, crop_maps(face.maps, prediction.crop)),
        )

    def _fit(
        self, prediction: PredictedMaps, image: UInt8[ndarray, "h w 3"]
    ) -> tuple[Float64[ndarray, "68 2"] | None, str | None]:
        image_centre = prediction.crop.to_crop(np.array([image.shape[1], image.shape[0]]) / 2)
        try:
            fitted = self.fit(prediction.maps, image_centre).in_image(prediction.crop)
        except DegenerateGeometryError as error:
            return None, str(error)
        landmarks2d = np.asarray(fitted.landmarks2d, dtype=np.float64)
        if not np.isfinite(landmarks2d).all():
            return None, "the fitted landmarks are not finite"
        return landmarks2d, None

    def _errors(self, landmarks2d: Float64[ndarray, "68 2"], face: BenchmarkFace) -> dict[str, float]:
        return {
            name: nme(landmarks2d, face.landmarks2d, self.normaliser, points) for name, points in POINT_SETS.items()
        }


def evaluate_faces(
    items: Sequence[BenchmarkItem], evaluator: Evaluator, on_done: Callable[[], None] = lambda: None
) -> tuple[list[FaceResult], list[Unreadable]]:
    """Evaluates all faces of a benchmark.

    Args:
        items: The faces.
        evaluator: How.
        on_done: Called after each face.

    Returns:
        Results in the order of the items, and the faces whose files cannot be used.
    """
    results: list[FaceResult] = []
    unreadable: list[Unreadable] = []
    for item in items:
        try:
            results.append(evaluator.evaluate(item.load()))
        except (InputFileError, DegenerateGeometryError) as error:
            unreadable.append(Unreadable(item.name, str(error)))
        on_done()
    return results, unreadable


def mean_face_in_box(model: MorphableModel, box: FaceBox) -> Float64[ndarray, "68 2"]:
    """The trivial baseline: the mean face's landmarks, seen from the front, placed in a face box.

    Orthographic and upright; scaled alike in both directions so that the tight box of the landmarks has the area of the
    face box, its centre on that of the face box.

    Raises:
        UsageError: The model has no 68 landmarks.
    """
    frontal = model_landmarks(model)[:, :2].astype(np.float64) * [1, -1]
    tight = FaceBox.around(frontal)
    scale = np.sqrt(box.width * box.height / (tight.width * tight.height))
    return (frontal - tight.centre) * scale + box.centre


def model_landmarks(model: MorphableModel) -> Float[ndarray, "68 3"]:
    """The 68 landmarks of the mean face, mm, model frame.

    Raises:
        UsageError: The model has none.
    """
    if IBUG68 not in model.landmarks:
        known = ", ".join(sorted(model.landmarks)) or "none"
        raise UsageError(f"expected a model with the landmarks {IBUG68}, found {known} in {model.name}")
    return model.mean[model.landmarks[IBUG68]]


def compare_maps(predicted: FaceMaps, truth: FaceMaps) -> MapErrors:
    """Errors of predicted maps against true ones of the same pixels."""
    common, either = predicted.mask & truth.mask, predicted.mask | truth.mask
    iou = float(common.sum() / either.sum()) if either.any() else 1.0
    if not common.any():
        return MapErrors(None, None, None, iou)
    return MapErrors(
        pncc_mm=_mean_length(predicted.pncc[common] - truth.pncc[common]),
        offset_mm=_mean_length(predicted.offset[common] - truth.offset[common]),
        offset_baseline_mm=_mean_length(truth.offset[common]),
        mask_iou=iou,
    )


def _mean_length(vectors: Float[ndarray, "n 3"]) -> float:
    return float(np.linalg.norm(vectors, axis=1).mean(dtype=np.float64))
