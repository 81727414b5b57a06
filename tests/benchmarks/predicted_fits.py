"""What the options of the fit are worth on the maps that a network predicts: error and time, variant by variant.

    python -m tests.benchmarks.predicted_fits AFLW2000/ [--checkpoint C] [--every 1] [--out FILE.json]

Each photograph of the folder goes through the network once, at its true box; then each variant fits the same maps. A
row has the mean error of the 68 points by bin of yaw (of the model fitted to the true points) and the mean of the bins,
in % of sqrt(w h); how many are above 10 %; the median of found over true extent of the landmarks; the errors that are
left where size and place are put right, and where the camera is (the one that projects the fitted landmarks closest to
the true points); and milliseconds of processor time a face, one core.
"""

import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any, final

import cv2
import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from threadpoolctl import threadpool_limits

from pix2face.evaluation.benchmarks.benchmark_data import YAW_BINS, yaw_bin
from pix2face.face_files.annotations import find_annotations
from pix2face.files.images import read_photograph
from pix2face.fitting.cameras.camera_fit import fit_weak_perspective_camera
from pix2face.fitting.face_fit import FaceFit, fit_face
from pix2face.fitting.fit_options import FitOptions
from pix2face.fitting.from_landmarks import fit_landmarks
from pix2face.fitting.picture_measurement import PREDICTED_MAPS_VERTICES
from pix2face.geometry.camera import head_pose
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.landmark_metrics import nme
from pix2face.geometry.landmarks import IBUG68
from pix2face.geometry.maps import FaceMaps
from pix2face.inference import PACKAGED
from pix2face.inference.onnx_session import keep_networks_in_one_thread
from pix2face.inference.predictor import Predictor
from pix2face.landmark_choice.landmark_file import with_own_landmarks
from pix2face.models.morphable_model import MorphableModel, builtin_model
from tests.benchmarks.measuring import options_parser, write_report

Fit = Callable[[FaceMaps], FaceFit]


@final
@dataclass(frozen=True, eq=False)
class PredictedFace:
    """What the network says of a face, and the truth in the same pixels."""

    maps: FaceMaps
    true2d: Float64[ndarray, "68 2"]
    yaw_bin: str


def variants(model: MorphableModel) -> dict[str, Fit]:
    """By name; each differs from the first in what the name says."""

    def fit(maps: FaceMaps, n_vertices: int | None = None, **changes: Any) -> FaceFit:
        return fit_face(maps, model, FitOptions(**changes), n_vertices=n_vertices)

    return {
        "held to the silhouette and corrected (the default)": fit,
        "held, not corrected": lambda maps: fit(maps, correction=False),
        "not held": lambda maps: fit(maps, silhouette=False),
        "not held, camera by all pixels of the mask": lambda maps: fit(replace(maps, seen=None), silhouette=False),
        "held, camera by all pixels of the mask": lambda maps: fit(replace(maps, seen=None)),
        "not held, two reprojections": lambda maps: fit(maps, silhouette=False, reprojection_rounds=2),
        "not held, affine camera": lambda maps: fit(maps, silhouette=False, camera="affine"),
        "held, two rounds": lambda maps: fit(maps, reprojection_rounds=2),
        "held, lambda 5": lambda maps: fit(maps, regularisation=5.0),
        "held, lambda 80": lambda maps: fit(maps, regularisation=80.0),
        "held, lambda estimated": lambda maps: fit(maps, regularisation="estimate", n_vertices=PREDICTED_MAPS_VERTICES),
        "held, 600 vertices": lambda maps: fit(maps, n_vertices=600),
        "held, 2,500 vertices": lambda maps: fit(maps, n_vertices=2500),
    }


def predicted_faces(folder: Path, predictor: Predictor, model: MorphableModel, every: int) -> list[PredictedFace]:
    """Every n-th annotated photograph."""
    found = []
    for annotation in find_annotations(folder, IBUG68)[::every]:
        annotated = annotation.load()
        prediction = predictor.predict(read_photograph(annotated.image_path), FaceBox.around(annotated.landmarks2d))
        yaw = head_pose(fit_landmarks(model, annotated.landmarks2d).camera).yaw_deg
        found.append(PredictedFace(prediction.maps, prediction.crop.to_crop(annotated.landmarks2d), yaw_bin(yaw)))
    return found


def row(faces: Sequence[PredictedFace], fit: Fit) -> dict[str, float]:
    """Fits all and measures."""
    fit(faces[0].maps)  # gathers what the model needs
    errors, right_cameras = defaultdict(list), defaultdict(list)
    shapes, sizes, seconds = [], [], 0.0
    for face in faces:
        began = process_time()
        fitted = fit(face.maps)
        seconds += process_time() - began
        found = fitted.landmarks2d
        errors[face.yaw_bin].append(100 * nme(found, face.true2d, "box-sqrt"))
        camera = fit_weak_perspective_camera(fitted.landmarks3d, face.true2d)
        right_cameras[face.yaw_bin].append(100 * nme(camera.project(fitted.landmarks3d), face.true2d, "box-sqrt"))
        centred, true = (points - points.mean(axis=0) for points in (found, face.true2d))
        sizes.append(float(np.linalg.norm(centred) / np.linalg.norm(true)))
        shapes.append(100 * nme(centred / sizes[-1], true, "box-sqrt"))
    means = {name: float(np.mean(errors[name])) for name in YAW_BINS if errors[name]}
    right = [float(np.mean(right_cameras[name])) for name in means]
    each = np.concatenate(list(errors.values()))
    return {
        **means,
        "mean of bins": float(np.mean(list(means.values()))),
        "above 10 %": 100 * float((each > 10).mean()),
        "found over true size": float(np.median(sizes)),
        "error with size and place put right": float(np.mean(shapes)),
        "mean of bins with the camera put right": float(np.mean(right)),
        "ms": 1e3 * seconds / len(faces),
    }


def main() -> None:
    """Measures and writes."""
    parser = options_parser(__doc__, Path("out/predicted_fits.json"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--checkpoint", type=Path)
    parser.add_argument("--every", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    keep_networks_in_one_thread()
    predictor = Predictor.load(options.checkpoint or PACKAGED, "cpu")
    model = with_own_landmarks(builtin_model(), predictor.header)
    with threadpool_limits(1):
        faces = predicted_faces(options.folder, predictor, model, options.every)
        rows = {}
        for name, fit in variants(model).items():
            rows[name] = {key: round(value, 3) for key, value in row(faces, fit).items()}
            sys.stderr.write(f"{name}: {rows[name]}\n")
    write_report({"faces": len(faces), "rows": rows}, options.out)


if __name__ == "__main__":
    main()
