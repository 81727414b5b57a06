"""How well known weights of ARKit's blendshapes come back: renders with known named expressions -> fit -> weights.

    datagen sample --n 240 --seed 77 --out faces.h5
    python -m tests.benchmarks.blendshapes --as-clips faces.h5
    datagen render --coeffs faces.h5 --out shards/
    python -m tests.benchmarks.blendshapes shards/ [--out FILE.json]

The second line gives each 24 faces in a row the identity of their first one, so that they are as the frames of a clip:
`track` fits one identity to all frames of a clip, which tells expressions from identity. Frames are fitted as it does,
to their exact maps and to those that the packaged network predicts from their pictures, at their true boxes. For both,
the report has the mean absolute error of a weight (and what it would be if all were 0), that of the weights that are
not 0, and the correlation of found and true weights over faces: of all weights, the median of the names, and each name.
Names that fewer than ten faces show have no correlation. Frontal faces have a yaw of at most 30 degrees.
"""

import sys
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import final

import h5py
import numpy as np
from numpy import ndarray

from datagen.sampling.expressions import strengths_of
from pix2face.api import Pix2Face
from pix2face.fitting.fit_options import DEFAULT_FIT, EXACT_MAPS_REGULARISATION, FitOptions
from pix2face.fitting.least_squares.linear_system import JointAccumulator
from pix2face.fitting.picture_measurement import measure_picture
from pix2face.geometry.camera import head_pose
from pix2face.geometry.crops import FaceBox
from pix2face.shards.shard_dataset import ShardDataset
from pix2face.tracking.export.blendshapes import ARKIT_NAMES, BlendshapeSolver
from tests.benchmarks.measuring import options_parser, write_report

FRAMES_OF_A_CLIP = 24
LEAST_FACES = 10
FRONTAL_DEG = 30.0
EXACT = FitOptions(regularisation=EXACT_MAPS_REGULARISATION, silhouette=False)


@final
@dataclass(frozen=True, eq=False)
class FittedFaces:
    """True weights, and the expressions of both fits; one face a row."""

    weights: ndarray
    exact: ndarray
    predicted: ndarray
    is_frontal: ndarray


def make_clips(table: Path) -> None:
    """Gives faces in a row the same identity, in a table of coefficients."""
    with h5py.File(table, "r+") as file:
        identity = file["identity"][()]
        file["identity"][...] = identity[np.arange(len(identity)) // FRAMES_OF_A_CLIP * FRAMES_OF_A_CLIP]


def fit_all(folder: Path, pix2face: Pix2Face) -> FittedFaces:
    """Fits every clip of a folder of shards."""
    model = pix2face.model
    clips = defaultdict(list)
    rows: list[tuple[ndarray, bool]] = []
    for sample in ShardDataset(folder):
        strengths = strengths_of(sample.attributes)
        (prediction,) = pix2face.predict(sample.image, [FaceBox.around(sample.landmarks2d)])
        measured = (
            measure_picture(sample.maps, model, EXACT),
            measure_picture(prediction.maps, model, DEFAULT_FIT),
        )
        clips[sample.identity.tobytes()].append((len(rows), measured))
        is_frontal = abs(head_pose(sample.camera).yaw_deg) <= FRONTAL_DEG
        rows.append((np.array([strengths.get(name, 0.0) for name in ARKIT_NAMES]), is_frontal))
    found = np.zeros((2, len(rows), model.n_expression))
    for frames in clips.values():
        for kind in range(2):
            systems = JointAccumulator(model.n_identity)
            for _, measured in frames:
                systems.add(measured[kind].system, measured[kind].regularisation)
            found[kind, [index for index, _ in frames]] = systems.solve()[1]
    weights, is_frontal = (np.array(column) for column in zip(*rows, strict=True))
    return FittedFaces(weights, *found, is_frontal)


def correlation(found: ndarray, truth: ndarray) -> float | None:
    """None where there is too little to compare."""
    if (truth > 0).sum() < LEAST_FACES or not np.ptp(found) > 0:
        return None
    return float(np.corrcoef(found.ravel(), truth.ravel())[0, 1])


def figures(found: ndarray, truth: ndarray) -> dict[str, object]:
    """Errors and correlations of weights."""
    errors = np.abs(found - truth)
    by_name = {name: correlation(found[:, index], truth[:, index]) for index, name in enumerate(ARKIT_NAMES)}
    known = [value for value in by_name.values() if value is not None]
    return {
        "faces": len(truth),
        "mean_error": round(float(errors.mean()), 3),
        "mean_error_of_zeros": round(float(truth.mean()), 3),
        "mean_error_where_not_0": round(float(errors[truth > 0].mean()), 3),
        "correlation": round(correlation(found, truth) or 0.0, 3),
        "median_correlation_of_names": round(float(np.median(known)), 3) if known else None,
        "by_name": {name: None if value is None else round(value, 2) for name, value in by_name.items()},
    }


def main(arguments: list[str]) -> int:
    parser = options_parser(__doc__)
    parser.add_argument("folder", type=Path, help="folder of shards, or a table of coefficients with --as-clips")
    parser.add_argument("--as-clips", action="store_true", help="only give faces in a row the same identity")
    options = parser.parse_args(arguments)
    if options.as_clips:
        make_clips(options.folder)
        return 0
    pix2face = Pix2Face.load()
    faces, solver = fit_all(options.folder, pix2face), BlendshapeSolver(pix2face.model)
    report: dict[str, object] = {}
    for name, expressions in (("exact maps", faces.exact), ("predicted maps", faces.predicted)):
        found = np.array([solver.weights(own) for own in expressions])
        report[name] = figures(found, faces.weights)
        report[f"{name}, frontal faces"] = figures(found[faces.is_frontal], faces.weights[faces.is_frontal])
    write_report(report, options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
