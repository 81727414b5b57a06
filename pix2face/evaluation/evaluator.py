"""Measures a subject on a benchmark: one result for each face, beside the result of a trivial baseline.

A face that the subject does not find stays in the figures with the error infinity. A face whose own files are damaged
is listed and left out.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace, BenchmarkItem, Unreadable, wrap_angle_deg
from pix2face.evaluation.figures.detection_summary import FaceDetection
from pix2face.evaluation.figures.pose_summary import PoseErrors
from pix2face.evaluation.subjects.subjects import FoundFace, Subject
from pix2face.evaluation.subjects.truth_errors import CoefficientErrors, MapErrors, compare_coefficients, compare_maps
from pix2face.geometry import Alignment, Normaliser
from pix2face.geometry.camera import HeadPose, angle_between_poses_deg
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.landmark_metrics import (
    POINT_SETS,
    distances3d,
    landmark_errors,
    normalising_distance,
)
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import MorphableModel

BASELINE = "baseline"
NOT_FOUND = FoundFace(landmarks2d=None)


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class FaceResult:
    """The result for one face. What the truth or the subject does not know is None."""

    name: str  # its name in lists
    group: str  # the column of the table in which it counts
    clip: str | None  # the clip of a frame
    yaw_deg: float | None  # true yaw
    has_unusual_angle: bool  # whether an angle of the truth is beyond ±99°
    landmark_errors: Float64[ndarray, "68"]  # of each landmark, a fraction; infinity where the face was not found
    baseline_errors: Float64[ndarray, "68"]  # the same for the mean face placed in the box
    landmarks2d: Float64[ndarray, "68 2"] | None  # found landmarks in image pixels; None where the face was not found
    failure: str | None  # why it was not found
    pose_deg: Float64[ndarray, "3"] | None = None  # found pitch, yaw, roll
    pose_errors_deg: PoseErrors | None = None
    z_px: Float64[ndarray, "68"] | None = None  # of the found landmarks in the picture, towards the viewer
    # of each landmark in 3D, in the unit of the data (a fraction for the alignment `depth`); infinity if not found
    distances3d: Float64[ndarray, "68"] | None = None
    baseline_distances3d: Float64[ndarray, "68"] | None = None  # the same for the mean face
    maps: MapErrors | None = None
    coefficients: CoefficientErrors | None = None
    detection: FaceDetection | None = None  # where a detector looked for the face

    def error(self, points: str = "68", method: str | None = None) -> float:
        """The mean error over a point set of the baseline, or (any other method) of what was found."""
        errors = self.baseline_errors if method == BASELINE else self.landmark_errors
        return float(errors[list(POINT_SETS[points])].mean())


@final
@dataclass(frozen=True, eq=False)
class Evaluator:
    """Everything that one evaluation holds fixed."""

    model: MorphableModel  # its mean face is the baseline
    subject: Subject  # what is measured
    normaliser: Normaliser  # what errors are divided by
    alignment: Alignment = "rigid"  # how 3D landmarks are aligned with the true ones

    def evaluate(self, faces: Sequence[BenchmarkFace]) -> list[FaceResult]:
        """Finds and measures some faces at once.

        Raises:
            DegenerateGeometryError: True landmarks have no extent.
        """
        found = self.subject.find(faces)
        return [self._measure(face, own) for face, own in zip(faces, found, strict=True)]

    def _measure(self, face: BenchmarkFace, found: FoundFace) -> FaceResult:
        landmarks2d, failure = found.landmarks2d, found.failure
        if landmarks2d is not None and not np.isfinite(landmarks2d).all():
            landmarks2d, failure = None, "the landmarks are not finite"
        fitted = np.full((68, 2), np.nan) if landmarks2d is None else landmarks2d
        baseline = mean_face_in_box(self.model, FaceBox.around(face.landmarks2d))
        return FaceResult(
            name=face.name,
            group=face.group,
            clip=face.clip,
            yaw_deg=face.yaw_deg,
            has_unusual_angle=face.has_unusual_angle,
            landmark_errors=landmark_errors(fitted, face.landmarks2d, self.normaliser),
            baseline_errors=landmark_errors(baseline, face.landmarks2d, self.normaliser),
            landmarks2d=landmarks2d,
            failure=failure,
            pose_deg=found.pose_deg,
            pose_errors_deg=_compare_poses(face, found),
            z_px=None if landmarks2d is None else found.z_px,
            distances3d=self._distances3d(face, found if landmarks2d is not None else NOT_FOUND),
            baseline_distances3d=self._distances3d(face, self._baseline(baseline)),
            maps=compare_maps(found, face),
            coefficients=compare_coefficients(self.model, found, face),
            detection=found.detection,
        )

    def _baseline(self, landmarks2d: Float64[ndarray, "68 2"]) -> FoundFace:
        landmarks3d = model_landmarks(self.model).astype(np.float64)
        scale = float(np.ptp(landmarks2d[:, 0]) / np.ptp(landmarks3d[:, 0]))
        return FoundFace(landmarks2d=landmarks2d, landmarks3d=landmarks3d, z_px=scale * landmarks3d[:, 2])

    def _distances3d(self, face: BenchmarkFace, found: FoundFace) -> Float64[ndarray, "68"] | None:
        if face.landmarks3d is None:
            return None
        points, unit = found.landmarks3d, 1.0
        if self.alignment == "depth":
            unit, points = normalising_distance(face.landmarks2d, self.normaliser), None
            if found.landmarks2d is not None:
                if found.z_px is None:
                    return None  # the subject finds places in the picture alone
                points = np.column_stack([found.landmarks2d, found.z_px])
        if points is None:
            return np.full(68, np.inf)
        try:
            return distances3d(points, face.landmarks3d, self.alignment) / unit
        except DegenerateGeometryError:
            return np.full(68, np.inf)


def evaluate_faces(
    items: Sequence[BenchmarkItem],
    evaluator: Evaluator,
    on_done: Callable[[int], None] = lambda n: None,
    batch_size: int = 1,
) -> tuple[list[FaceResult], list[Unreadable]]:
    """Evaluates all faces of a benchmark: results in their order, and the faces whose files cannot be used.

    ``on_done`` gets the number of faces that were just done. ``batch_size`` faces go through the network at once, and
    all of their pictures are in memory.
    """
    results: list[FaceResult] = []
    unreadable: list[Unreadable] = []
    for start in range(0, len(items), batch_size):
        batch = items[start : start + batch_size]
        results += evaluator.evaluate(list(_readable(batch, evaluator, unreadable)))
        on_done(len(batch))
    return results, unreadable


def _readable(
    items: Sequence[BenchmarkItem], evaluator: Evaluator, unreadable: list[Unreadable]
) -> Iterator[BenchmarkFace]:
    """The faces whose truth (and picture, where it is looked at) can be used; the others are added to the list."""
    for item in items:
        try:
            face = item.load()
            normalising_distance(face.landmarks2d, evaluator.normaliser)
            FaceBox.around(face.landmarks2d)
            yield face.with_image() if evaluator.subject.needs_images else face
        except (InputFileError, DegenerateGeometryError) as error:
            unreadable.append(Unreadable(item.name, str(error)))


def mean_face_in_box(model: MorphableModel, box: FaceBox) -> Float64[ndarray, "68 2"]:
    """The trivial baseline: the mean face's landmarks, seen from the front, placed in a face box.

    Orthographic and upright; scaled alike in both directions so that the tight box of the landmarks has the area of the
    face box, its centre on that of the face box.

    Raises:
        UsageError: The model has no 68 landmarks.
    """
    frontal = frontal_landmarks(model)
    tight = FaceBox.around(frontal)
    scale = np.sqrt(box.width * box.height / (tight.width * tight.height))
    return (frontal - tight.centre) * scale + box.centre


def frontal_landmarks(model: MorphableModel) -> Float64[ndarray, "68 2"]:
    """The 68 landmarks of the mean face seen from the front: x right, y down, mm."""
    return model_landmarks(model)[:, :2].astype(np.float64) * [1, -1]


def model_landmarks(model: MorphableModel) -> Float[ndarray, "68 3"]:
    """The 68 landmarks of the mean face, mm, model frame.

    Raises:
        UsageError: The model has none.
    """
    if IBUG68 not in model.landmarks:
        known = ", ".join(sorted(model.landmarks)) or "none"
        raise UsageError(f"expected a model with the landmarks {IBUG68}, found {known} in {model.name}")
    return model.mean[model.landmarks[IBUG68]]


def _compare_poses(face: BenchmarkFace, found: FoundFace) -> PoseErrors | None:
    if face.pose is None or found.pose_deg is None or found.failure is not None:
        return None
    own = HeadPose(*(float(angle) for angle in found.pose_deg))
    differences = [
        wrap_angle_deg(found_deg - true_deg)
        for found_deg, true_deg in zip(astuple(own), astuple(face.pose), strict=True)
    ]
    return PoseErrors(np.array(differences), angle_between_poses_deg(own, face.pose))
