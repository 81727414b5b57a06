"""Opens the subject of an evaluation: a checkpoint, a file of landmarks, or the model itself as an oracle."""

import json
import platform
from dataclasses import asdict
from hashlib import sha256
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from pix2face import __version__
from pix2face.detectors.detection import open_detector
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFiles
from pix2face.evaluation.benchmarks.benchmark_search import match_names
from pix2face.evaluation.benchmarks.manifest import Manifest
from pix2face.evaluation.evaluate_config import EvaluateConfig, PixelFrame
from pix2face.evaluation.subjects.detected_faces import FaceSearch
from pix2face.evaluation.subjects.predictions_file import read_predictions, read_tracks
from pix2face.evaluation.subjects.subjects import (
    NetworkSubject,
    OracleSubject,
    PredictionsSubject,
    Subject,
)
from pix2face.fitting.face_fit import fit_face
from pix2face.inference.predictor import Predictor
from pix2face.landmark_choice.landmark_file import with_own_landmarks
from pix2face.models.morphable_model import MorphableModel, builtin_model

# Poses of 300W-LP and AFLW2000-3D are those of the mean face of BFM 2009. Laid onto the built-in model's mean face by
# their 68 landmarks, BFM's is turned by this angle about x (python -m scripts.measure_correspondence prints it): a face
# in a photograph has another pitch for each of the two models.
BFM_IN_BUILTIN_DEG = 4.4


def open_subject(
    config: EvaluateConfig, model: MorphableModel, manifest: Manifest, found: BenchmarkFiles
) -> tuple[Subject, dict[str, Any]]:
    """The subject that is measured, and its description for the report.

    Raises:
        InputFileError: The checkpoint or the file of landmarks cannot be used.
        ModelMismatchError: The checkpoint is of another model.
        UsageError: The file names faces that the benchmark does not have, or there is no checkpoint.
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
    return "those of the model" if config.network.landmarks is None else f"those of {config.network.landmarks}"


def versions() -> dict[str, str]:
    """The versions of the project and of everything that influences the figures."""
    names = ["numpy", "scipy", "onnxruntime", "opencv-python-headless", "matplotlib"]
    if find_spec("torch") is not None:  # it runs networks on GPUs
        names.append("torch")
    return {"pix2face": __version__, "python": platform.python_version()} | {name: version(name) for name in names}


def _network(config: EvaluateConfig, model: MorphableModel, manifest: Manifest) -> tuple[Subject, dict[str, Any]]:
    how, checkpoint = config.how, config.network.path
    predictor = Predictor.load(checkpoint, config.network.device)
    if config.crop_scale is not None:
        predictor = predictor.with_crop_scale(config.crop_scale)
    predictor.header.check_model(model.name, model.sha256)
    # Renders are annotated by the model's vertices; a checkpoint's own stand for how people annotate photographs.
    takes_own = config.network.landmarks is None and manifest.kind != "shards"
    if takes_own:
        model = with_own_landmarks(model, predictor.header)
    search = None
    if config.boxes == "detected":
        own_predictor, own_model = (predictor, model) if config.refine else (None, None)
        detector = open_detector(config.detector, config.smallest_face)
        search = FaceSearch(detector, own_predictor, own_model, config.min_score)
    subject = NetworkSubject(
        predictor,
        lambda maps, image_centre: fit_face(maps, model, how, principal_point_px=image_centre),
        None if search is None else search.find,
        model_from_stated(model, manifest),
    )
    is_estimated = how.regularisation == "estimate"
    regularisation = "estimated for each face" if is_estimated else f"{how.regularisation:g} mm^2"
    header = asdict(predictor.header)
    header["configuration"] = json.loads(predictor.header.configuration)
    return subject, {
        "checkpoint": f"{checkpoint} (epoch {predictor.header.epoch}, {predictor.header.size_px} px)",
        "crop": f"{predictor.header.crop_scale:g} of the box's longer side",
        "fit": f"{how.camera} camera, regularisation {regularisation}, "
        f"{how.reprojection_rounds} rounds of reprojection asked for, "
        f"{'' if how.is_held else 'not '}held to the silhouette"
        f"{', corrected by the network' if how.is_corrected and predictor.header.n_corrected else ''}",
        "landmarks": "those that the checkpoint brings along"
        if predictor.header.landmarks and takes_own
        else _landmarks_of_model(config),
        "hashes": {"checkpoint": sha256(checkpoint.read_bytes()).hexdigest()},
        "checkpoint_header": header,
    }


def _predictions(
    path: Path, frame: PixelFrame, manifest: Manifest, found: BenchmarkFiles
) -> tuple[Subject, dict[str, Any]]:
    if path.is_dir():
        tracked = read_tracks(path, {item.name for item in found.items}, found.frame_names)
        rows = {name: row for row, name in enumerate(tracked.names)}
        return PredictionsSubject(tracked, rows), {"predictions": f"{path} ({len(rows)} frames of pix2face track)"}
    predicted = read_predictions(path, frame)
    known = [item.name for item in found.items] + list(found.absent_names)
    # The number of frames of a missing clip is unknown, so every name of a frame of it is accepted.
    clips = {clip for part in manifest.parts for clip in part.clips}
    absent_clips = clips - {name.partition("/")[0] for name in known}
    known += [name for name in predicted.names if name.partition("/")[0] in absent_clips]
    rows = match_names(predicted.names, known, f"{manifest.split} ({path})")
    return PredictionsSubject(predicted, rows), {
        "predictions": f"{path} ({len(predicted.names)} faces, pixels {frame})",
        "hashes": {"predictions": sha256(path.read_bytes()).hexdigest()},
    }


def model_from_stated(model: MorphableModel, manifest: Manifest) -> Float64[ndarray, "3 3"]:
    """Rotation to a model's frame from the frame in which a benchmark states poses.

    It is the identity for our own renders, and for imported models, which keep the frame that they were published in
    (for BFM, the frame of the benchmarks).
    """
    if manifest.kind == "shards" or model.sha256 != builtin_model().sha256:
        return np.eye(3)
    return np.asarray(Rotation.from_euler("x", BFM_IN_BUILTIN_DEG, degrees=True).as_matrix(), dtype=np.float64)
