"""Opens what an evaluation measures: a checkpoint, a file of landmarks, or the model itself as an oracle."""

import json
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, final

from jaxtyping import Float64
from numpy import ndarray

from pix2face import __version__
from pix2face.detectors.detection import open_detector
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFiles
from pix2face.evaluation.benchmarks.detection_boxes import DetectedBox
from pix2face.evaluation.benchmarks.face_names import match_names
from pix2face.evaluation.benchmarks.manifest import Manifest
from pix2face.evaluation.subjects.pose_frame import model_from_stated
from pix2face.evaluation.subjects.predictions_file import PixelFrame, read_predictions
from pix2face.evaluation.subjects.subjects import (
    NetworkSubject,
    OracleSubject,
    PredictionsSubject,
    Subject,
    fitted_landmarks,
    true_box,
)
from pix2face.evaluation.subjects.tracks_as_predictions import read_tracks
from pix2face.fitting.face_fit import CameraKind, FaceFit, fit_face
from pix2face.fitting.picture_measurement import HELD_CAMERAS
from pix2face.geometry.maps import FaceMaps
from pix2face.inference.default_checkpoint import PACKAGED
from pix2face.inference.predictor import Predictor
from pix2face.landmark_choice.contour_landmarks import contour_landmarks2d
from pix2face.landmark_choice.landmark_file import with_own_landmarks
from pix2face.models.morphable_model import MorphableModel


@final
@dataclass(frozen=True, kw_only=True)
class SubjectOptions:
    """What to measure.

    Attributes:
        checkpoint: What training wrote; None takes the packaged one.
        predictions: File of another system's landmarks instead.
        frame: Where that has its pixel centres.
        oracle: Fit the model to the truth instead.
        boxes: "truth", or the name of a detector.
        slides_jaw: Whether jaw points slide to the visible outline.
        camera: Of the fit.
        regularisation: Tikhonov weight of the coefficients in mm^2; None estimates it for each face.
        silhouette: Whether the fit is held to it.
        reprojection_rounds: Of the fit.
        crop_scale: Of the crop that the network is given; None is the checkpoint's own.
        landmarks: File of the model's landmarks, if one was asked for; otherwise, of photographs, a checkpoint may
            bring its own.
    """

    checkpoint: Path | None
    predictions: Path | None
    frame: PixelFrame
    oracle: bool
    boxes: str
    slides_jaw: bool
    camera: CameraKind
    regularisation: float | None
    silhouette: bool = True
    reprojection_rounds: int = 0
    crop_scale: float | None = None
    landmarks: Path | None = None

    @property
    def landmarks_of_model(self) -> str:
        """Which vertices the landmarks of the model are, in words."""
        return "vertices of the model" if self.landmarks is None else f"vertices of {self.landmarks}"


def open_subject(
    options: SubjectOptions, model: MorphableModel, manifest: Manifest, found: BenchmarkFiles
) -> tuple[Subject, dict[str, Any]]:
    """What is measured, and its description for the report.

    Raises:
        InputFileError: The checkpoint or the file of landmarks cannot be used.
        ModelMismatchError: The checkpoint is of another model.
        UsageError: The file names faces that the benchmark has not, or there is no checkpoint.
    """
    if options.predictions is not None:
        return _predictions(options.predictions, options.frame, manifest, found)
    if options.oracle:
        maps = f"true maps (camera: {options.camera})"
        landmarks = "true 2D landmarks (camera: weak-perspective)"
        what = maps if manifest.kind == "shards" else landmarks
        subject = OracleSubject(model, options.slides_jaw, options.camera, model_from_stated(model, manifest))
        oracle = f"the model fitted to the {what} of each face"
        return subject, {"oracle": oracle, "landmarks": options.landmarks_of_model}
    return _network(options, model, manifest)


def versions() -> dict[str, str]:
    """Of the project and of everything that decides figures."""
    names = ("numpy", "scipy", "torch", "opencv-python-headless", "matplotlib")
    return {
        "pix2face": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in names},
    }


def _network(options: SubjectOptions, model: MorphableModel, manifest: Manifest) -> tuple[Subject, dict[str, Any]]:
    checkpoint = options.checkpoint or PACKAGED
    predictor = Predictor.load(checkpoint)
    if options.crop_scale is not None:
        predictor = predictor.with_crop_scale(options.crop_scale)
    predictor.header.check_model(model.name, model.sha256)
    # Renders are annotated by the model's vertices; a checkpoint's own stand for how people annotate photographs.
    takes_own = options.landmarks is None and manifest.kind != "shards"
    if takes_own:
        model = with_own_landmarks(model, predictor.header)
    subject = NetworkSubject(
        predictor,
        partial(_fit, model, options),
        true_box if options.boxes == "truth" else DetectedBox(open_detector(options.boxes), options.boxes),
        partial(contour_landmarks2d, model=model) if options.slides_jaw else fitted_landmarks,
        model_from_stated(model, manifest),
    )
    header = asdict(predictor.header)
    header["configuration"] = json.loads(predictor.header.configuration)
    return subject, {
        "checkpoint": f"{checkpoint} (epoch {predictor.header.epoch}, {predictor.header.size_px} px)",
        "crop": f"{predictor.header.crop_scale:g} of the box's longer side",
        "fit": f"{options.camera} camera, regularisation {_in_words(options.regularisation)}, "
        f"{options.reprojection_rounds} rounds of reprojection asked for, "
        f"{'' if options.silhouette and options.camera in HELD_CAMERAS else 'not '}held to the silhouette",
        "landmarks": "vertices that the checkpoint brings along"
        if predictor.header.landmarks and takes_own
        else options.landmarks_of_model,
        "hashes": {"checkpoint": sha256(checkpoint.read_bytes()).hexdigest()},
        "checkpoint_header": header,
    }


def _in_words(regularisation: float | None) -> str:
    return "estimated for each face" if regularisation is None else f"{regularisation:g} mm^2"


def _tracks(folder: Path, found: BenchmarkFiles) -> tuple[Subject, dict[str, Any]]:
    predicted = read_tracks(folder, {item.name for item in found.items}, found.frame_names)
    rows = {name: row for row, name in enumerate(predicted.names)}
    return PredictionsSubject(predicted, rows), {"predictions": f"{folder} ({len(rows)} frames of pix2face track)"}


def _absent_clips(manifest: Manifest, known: Sequence[str]) -> set[str]:
    return {clip for part in manifest.parts for clip in part.clips} - {name.partition("/")[0] for name in known}


def _fit(
    model: MorphableModel, options: SubjectOptions, maps: FaceMaps, image_centre: Float64[ndarray, "2"]
) -> FaceFit:
    return fit_face(
        maps,
        model,
        camera_kind=options.camera,
        regularisation=options.regularisation,
        silhouette=options.silhouette,
        reprojection_rounds=options.reprojection_rounds,
        principal_point_px=image_centre,
    )


def _predictions(
    path: Path, frame: PixelFrame, manifest: Manifest, found: BenchmarkFiles
) -> tuple[Subject, dict[str, Any]]:
    if path.is_dir():
        return _tracks(path, found)
    predicted = read_predictions(path, frame)
    known = [item.name for item in found.items] + list(found.absent_names)
    # Nobody knows how many frames a clip has that is not at hand: any name of one is believed.
    absent_clips = _absent_clips(manifest, known)
    known += [name for name in predicted.names if name.partition("/")[0] in absent_clips]
    rows = match_names(predicted.names, known, f"{manifest.split} ({path})")
    return PredictionsSubject(predicted, rows), {
        "predictions": f"{path} ({len(predicted.names)} faces, pixels {frame})",
        "hashes": {"predictions": sha256(path.read_bytes()).hexdigest()},
    }
