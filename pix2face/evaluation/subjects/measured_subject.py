"""Opens what an evaluation measures: a checkpoint, a file of landmarks, or the model itself as an oracle."""

import json
import platform
from collections.abc import Sequence
from dataclasses import asdict
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pix2face import __version__
from pix2face.detectors.detection import open_detector
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFiles
from pix2face.evaluation.benchmarks.detection_boxes import DetectedBox
from pix2face.evaluation.benchmarks.face_names import match_names
from pix2face.evaluation.benchmarks.manifest import Manifest
from pix2face.evaluation.evaluate_config import EvaluateConfig
from pix2face.evaluation.subjects.pose_frame import model_from_stated
from pix2face.evaluation.subjects.predictions_file import PixelFrame, read_predictions
from pix2face.evaluation.subjects.subjects import (
    NetworkSubject,
    OracleSubject,
    PredictionsSubject,
    Subject,
    true_box,
)
from pix2face.evaluation.subjects.tracks_as_predictions import read_tracks
from pix2face.fitting.face_fit import fit_face
from pix2face.fitting.fit_options import Regularisation
from pix2face.models.morphable_model import MorphableModel


def open_subject(
    config: EvaluateConfig, model: MorphableModel, manifest: Manifest, found: BenchmarkFiles
) -> tuple[Subject, dict[str, Any]]:
    """What is measured, and its description for the report.

    Raises:
        InputFileError: The checkpoint or the file of landmarks cannot be used.
        ModelMismatchError: The checkpoint is of another model.
        UsageError: The file names faces that the benchmark has not, or there is no checkpoint.
    """
    if config.predictions is not None:
        return _predictions(config.predictions, config.frame, manifest, found)
    if config.oracle:
        maps = f"true maps (camera: {config.how.camera})"
        landmarks = "true 2D landmarks (camera: weak-perspective)"
        what = maps if manifest.kind == "shards" else landmarks
        subject = OracleSubject(model, config.how, model_from_stated(model, manifest))
        oracle = f"the model fitted to the {what} of each face"
        return subject, {"oracle": oracle, "landmarks": _landmarks_of_model(config)}
    return _network(config, model, manifest)


def _landmarks_of_model(config: EvaluateConfig) -> str:
    return "vertices of the model" if config.network.landmarks is None else f"vertices of {config.network.landmarks}"


def versions() -> dict[str, str]:
    """Of the project and of everything that decides figures."""
    names = ("numpy", "scipy", "torch", "opencv-python-headless", "matplotlib")
    return {
        "pix2face": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in names},
    }


def _network(config: EvaluateConfig, model: MorphableModel, manifest: Manifest) -> tuple[Subject, dict[str, Any]]:
    how, checkpoint, predictor = config.how, config.network.path, config.network.open_predictor()
    if config.crop_scale is not None:
        predictor = predictor.with_crop_scale(config.crop_scale)
    predictor.header.check_model(model.name, model.sha256)
    # Renders are annotated by the model's vertices; a checkpoint's own stand for how people annotate photographs.
    if manifest.kind != "shards":
        model = config.network.with_chosen_landmarks(model, predictor)
    takes_own = config.network.landmarks is None and manifest.kind != "shards"
    subject = NetworkSubject(
        predictor,
        lambda maps, image_centre: fit_face(maps, model, how, principal_point_px=image_centre),
        true_box if config.boxes == "truth" else DetectedBox(open_detector(config.boxes), config.boxes),
        model_from_stated(model, manifest),
    )
    header = asdict(predictor.header)
    header["configuration"] = json.loads(predictor.header.configuration)
    return subject, {
        "checkpoint": f"{checkpoint} (epoch {predictor.header.epoch}, {predictor.header.size_px} px)",
        "crop": f"{predictor.header.crop_scale:g} of the box's longer side",
        "fit": f"{how.camera} camera, regularisation {_in_words(how.regularisation)}, "
        f"{how.reprojection_rounds} rounds of reprojection asked for, "
        f"{'' if how.is_held else 'not '}held to the silhouette",
        "landmarks": "vertices that the checkpoint brings along"
        if predictor.header.landmarks and takes_own
        else _landmarks_of_model(config),
        "hashes": {"checkpoint": sha256(checkpoint.read_bytes()).hexdigest()},
        "checkpoint_header": header,
    }


def _in_words(regularisation: Regularisation) -> str:
    return "estimated for each face" if regularisation == "estimate" else f"{regularisation:g} mm^2"


def _tracks(folder: Path, found: BenchmarkFiles) -> tuple[Subject, dict[str, Any]]:
    predicted = read_tracks(folder, {item.name for item in found.items}, found.frame_names)
    rows = {name: row for row, name in enumerate(predicted.names)}
    return PredictionsSubject(predicted, rows), {"predictions": f"{folder} ({len(rows)} frames of pix2face track)"}


def _absent_clips(manifest: Manifest, known: Sequence[str]) -> set[str]:
    return {clip for part in manifest.parts for clip in part.clips} - {name.partition("/")[0] for name in known}


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
