"""Measures how well a model fits the landmarks of AFLW2000-3D, to choose its regularisation.

python scripts/measure_retarget.py --data AFLW2000/ [--model builtin] [--regularisation 2]
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import final

import numpy as np
from jaxtyping import Float64, Int
from numpy import ndarray
from threadpoolctl import threadpool_limits

from pix2face.errors import UsageError
from pix2face.face_files.w300lp import CoefficientFile, read_coefficient_file
from pix2face.fitting.from_landmarks import (
    LANDMARK_REGULARISATION,
    LandmarkModel,
    fit_landmarks,
    fit_mean_to_landmarks,
)
from pix2face.geometry.camera import nearest_weak_perspective
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.landmarks import IBUG68_PARTS
from pix2face.models.morphable_model import open_model

N_FOLDS = 5
YAW_BINS_DEG = {"to 30": (0, 30), "to 60": (30, 60), "above": (60, 180.1), "all": (0, 180.1)}


@final
@dataclass(frozen=True, eq=False)
class FaceFigures:
    """The figures of one face.

    Attributes:
        yaw_deg: Yaw in the file, wrapped to ±180°.
        mean_face: Error of the fitted mean face: mean 2D distance over sqrt(w h) of the landmarks' box.
        fitted: Error of the fit with coefficients.
        mean_face_left_out: Error of the mean face at each landmark, if the landmark is left out of the fit.
        fitted_left_out: Error of the fit with coefficients at each landmark, if the landmark is left out of the fit.
        rms: RMS of all coefficients of the fit to all landmarks, in standard deviations.
        milliseconds: Time of the fit to all landmarks.
        residual_mm: Vector from each fitted to the given landmark in the model frame.
    """

    yaw_deg: float
    mean_face: float
    fitted: float
    mean_face_left_out: Float64[ndarray, "68"]
    fitted_left_out: Float64[ndarray, "68"]
    rms: float
    milliseconds: float
    residual_mm: Float64[ndarray, "68 3"]


@final
@dataclass(frozen=True)
class BinFigures:
    """The figures of a yaw bin; errors in % of sqrt(w h)."""

    faces: int
    mean_face: float
    fitted: float
    mean_face_left_out: float
    fitted_left_out: float
    mean_rms: float
    largest_rms: float
    milliseconds: float


def measure(folder: Path, model: LandmarkModel, *, regularisation: float, with_depth: bool) -> list[FaceFigures]:
    """Fits each file of a folder to all of its landmarks, and five times with a fifth of them left out.

    Raises:
        UsageError: There are no files.
    """
    paths = sorted(folder.glob("*.mat"))
    if not paths:
        raise UsageError(f"{folder}: expected .mat files of AFLW2000-3D, found none")
    options = {"regularisation": regularisation, "with_depth": with_depth}
    return [_figures(model, read_coefficient_file(path), **options) for path in paths]


def summarise(faces: Sequence[FaceFigures]) -> dict[str, BinFigures]:
    """Averages the figures over the faces of each yaw bin."""
    out = {}
    for name, (low, high) in YAW_BINS_DEG.items():
        chosen = [face for face in faces if low <= abs(face.yaw_deg) < high or abs(face.yaw_deg) == low == 0]
        out[name] = BinFigures(
            faces=len(chosen),
            mean_face=100 * float(np.mean([face.mean_face for face in chosen])),
            fitted=100 * float(np.mean([face.fitted for face in chosen])),
            mean_face_left_out=100 * float(np.mean([face.mean_face_left_out for face in chosen])),
            fitted_left_out=100 * float(np.mean([face.fitted_left_out for face in chosen])),
            mean_rms=float(np.mean([face.rms for face in chosen])),
            largest_rms=float(np.max([face.rms for face in chosen])),
            milliseconds=float(np.median([face.milliseconds for face in chosen])),
        )
    return out


def fold_of_landmark() -> Int[ndarray, "68"]:
    """Returns the fold of each landmark: every fifth is in the same, so that each has all parts of the face."""
    return np.arange(68) % N_FOLDS


def _figures(model: LandmarkModel, file: CoefficientFile, *, regularisation: float, with_depth: bool) -> FaceFigures:
    assert file.landmarks3d is not None
    landmarks2d = file.landmarks3d[:, :2]
    depths = file.landmarks3d[:, 2] if with_depth else None
    box = FaceBox.around(landmarks2d)
    normaliser = float(np.sqrt(box.width * box.height))
    start = perf_counter()
    fit = fit_landmarks(model, landmarks2d, regularisation=regularisation, depths_px=depths)
    milliseconds = 1000 * (perf_counter() - start)
    mean_face = fit_mean_to_landmarks(model, landmarks2d).project(model.mean)
    left_out = np.zeros((2, 68))
    for fold in range(N_FOLDS):
        held = fold_of_landmark() == fold
        weights = np.where(held, 0.0, 1.0)
        mean_of_rest = fit_mean_to_landmarks(model, landmarks2d, weights=weights).project(model.mean)
        of_rest = fit_landmarks(model, landmarks2d, weights=weights, regularisation=regularisation, depths_px=depths)
        for row, points in enumerate((mean_of_rest, of_rest.landmarks2d)):
            left_out[row, held] = np.linalg.norm(points - landmarks2d, axis=1)[held] / normaliser
    coefficients = np.concatenate([fit.identity, fit.expression])
    pose = nearest_weak_perspective(fit.camera)
    depth = file.landmarks3d[:, 2] / pose.scale - fit.camera.depth(model.landmarks3d(coefficients))
    in_camera = np.column_stack([(landmarks2d - fit.landmarks2d) / pose.scale, depth - depth.mean()])
    return FaceFigures(
        yaw_deg=(file.pose.head.yaw_deg + 180) % 360 - 180,
        mean_face=float(np.linalg.norm(mean_face - landmarks2d, axis=1).mean()) / normaliser,
        fitted=float(np.linalg.norm(fit.landmarks2d - landmarks2d, axis=1).mean()) / normaliser,
        mean_face_left_out=left_out[0],
        fitted_left_out=left_out[1],
        rms=float(np.sqrt((coefficients**2).mean())),
        milliseconds=milliseconds,
        residual_mm=in_camera @ pose.rotation,
    )


def _print_tables(faces: Sequence[FaceFigures]) -> None:
    print(f"{'yaw':8}{'faces':>6}{'mean face':>11}{'fitted':>8}{'gain':>7}   left out: "
          f"{'mean face':>10}{'fitted':>8}{'gain':>7}{'RMS':>7}{'max':>6}{'ms':>6}")  # fmt: skip
    for name, row in summarise(faces).items():
        gain = 100 * (1 - row.fitted / row.mean_face)
        gain_left_out = 100 * (1 - row.fitted_left_out / row.mean_face_left_out)
        print(
            f"{name:8}{row.faces:6}{row.mean_face:10.2f}%{row.fitted:7.2f}%{gain:6.0f}%{row.mean_face_left_out:22.2f}%"
            f"{row.fitted_left_out:7.2f}%{gain_left_out:6.0f}%{row.mean_rms:7.2f}{row.largest_rms:6.2f}{row.milliseconds:6.1f}"
        )
    residual = np.mean([face.residual_mm for face in faces], axis=0)
    error = 100 * np.mean([face.fitted_left_out for face in faces], axis=0)
    print("\nmean residual in mm (x to the subject's left, y up, z out) and left-out error:")
    for part, indices in IBUG68_PARTS.items():
        for i in indices:
            x, y, z = residual[i]
            print(f"  {part:6}{i:3} {x:6.1f}{y:6.1f}{z:6.1f} {error[i]:6.2f} %")


def main() -> None:
    """Prints the figures, or writes them as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--model", default="builtin")
    parser.add_argument("--regularisation", type=float, default=LANDMARK_REGULARISATION)
    parser.add_argument("--no-depth", action="store_true", help="fit to the 2D positions alone")
    parser.add_argument("--json", type=Path, help="write the table here as well")
    options = parser.parse_args()
    model = LandmarkModel.of(open_model(options.model))
    with threadpool_limits(1, user_api="blas"):  # the systems are so small that threads slow them down
        faces = measure(options.data, model, regularisation=options.regularisation, with_depth=not options.no_depth)
    _print_tables(faces)
    if options.json:
        table = {name: asdict(row) for name, row in summarise(faces).items()}
        options.json.write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
