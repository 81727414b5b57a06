"""Whether the errors that a network expects of its landmarks are those that they have.

    python -m tests.benchmarks.expected_errors AFLW2000/ [--checkpoint C] [--out FILE.json]

Each photograph of the folder is read at its true box and fitted. Landmarks, and then faces, are sorted by their
expected error and divided into eight groups of the same size. A row has the mean expected and the mean true error of a
group in % of sqrt(w h), and for faces also the expected and the true angle between the estimated head and the one
fitted to the true points. "constants" are those of ``pix2face.fitting.face_fit`` with which the means over all
photographs would be the same.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation
from scipy.stats import spearmanr

from pix2face.api import Pix2Face
from pix2face.errors import UsageError
from pix2face.face_files.annotations import find_annotations
from pix2face.files.images import read_photograph
from pix2face.fitting.face_fit import DEGREES_PER_PERCENT, ERROR_OF_FIT
from pix2face.fitting.from_landmarks import fit_landmarks
from pix2face.geometry.camera import nearest_weak_perspective
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.landmarks import IBUG68
from tests.benchmarks.measuring import options_parser, write_report

GROUPS = 8


def main() -> int:
    """Measures and writes."""
    parser = options_parser(__doc__, Path("out/expected_errors.json"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--checkpoint", type=Path)
    options = parser.parse_args()
    pix2face = Pix2Face.load(options.checkpoint)
    expected, true, sizes, angles = [], [], [], []
    for annotation in find_annotations(options.folder, IBUG68):
        annotated = annotation.load()
        box = FaceBox.around(annotated.landmarks2d)
        (fit,) = pix2face.fit(read_photograph(annotated.image_path), [box])
        if fit.landmark_errors_px is None:
            raise UsageError("expected a network that predicts landmarks, found one that does not")
        expected.append(fit.landmark_errors_px)
        true.append(np.linalg.norm(fit.landmarks2d - annotated.landmarks2d, axis=1))
        sizes.append(np.sqrt(np.prod(np.ptp(annotated.landmarks2d, axis=0))))
        heads = (
            nearest_weak_perspective(of).rotation
            for of in (fit.camera, fit_landmarks(fit.model, annotated.landmarks2d).camera)
        )
        first, second = heads
        angles.append(np.degrees(Rotation.from_matrix(first.T @ second).magnitude()))
    px, true_px = np.array(expected), np.array(true)
    percent = 100 / np.array(sizes)[:, None]
    of_faces = (px * percent).mean(axis=1)
    report = {
        "photographs": len(px),
        "constants": {
            "ERROR_OF_FIT": ERROR_OF_FIT * float((true_px * percent).mean() / of_faces.mean()),
            "DEGREES_PER_PERCENT": float(np.mean(angles) / (true_px * percent).mean()),
        },
        "rank_correlation": {
            "landmarks": float(spearmanr((px * percent).ravel(), (true_px * percent).ravel())[0]),
            "faces": float(spearmanr(of_faces, (true_px * percent).mean(axis=1))[0]),
            "angles": float(spearmanr(of_faces, angles)[0]),
        },
        "landmarks": groups((px * percent).ravel(), (true_px * percent).ravel()),
        "faces": groups(of_faces, (true_px * percent).mean(axis=1), DEGREES_PER_PERCENT * of_faces, np.array(angles)),
    }
    write_report(report, options.out)
    return 0


def groups(expected: Float64[ndarray, " n"], *true: Float64[ndarray, " n"]) -> list[list[float]]:
    """Means of groups of the same size, sorted by what was expected."""
    order = np.argsort(expected)
    parts: list[Any] = np.array_split(order, GROUPS)
    return [[round(float(values[part].mean()), 2) for values in (expected, *true)] for part in parts]


if __name__ == "__main__":
    sys.exit(main())
