"""How many faces the detectors find, and how well their boxes fit: python -m tests.benchmarks.detection.

    python -m tests.benchmarks.detection --faces FOLDER [--detectors cnn,dlib] [--checkpoint C]
        [--out out/detection.json]

Prints and writes JSON. For each detector: recall (overlap with an annotated face of more than half their union), false
boxes (overlap with every face below 0.3), overlap and errors of the boxes that hit, in % of the longer side of the
face's own box, seconds of one core for a photograph, and what its calibration should be by the medians over these
faces. With a checkpoint, the same after a first prediction has refined the boxes.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy import ndarray

from pix2face.detectors.detection import DETECTORS, Detector, open_detector
from pix2face.detectors.protocol import overlap, sure_faces
from pix2face.files.images import read_photograph
from pix2face.geometry.crops import FaceBox
from pix2face.inference.predictor import Predictor
from pix2face.models.morphable_model import builtin_model
from pix2face.photographs.refined_detection import refine_faces
from tests.benchmarks.face_finding import annotated_photographs
from tests.benchmarks.measuring import options_parser, write_report

HIT, FALSE = 0.5, 0.3

Finder = Callable[[ndarray], list[FaceBox]]


def measure(find: Finder, faces: Mapping[Path, Sequence[FaceBox]]) -> dict[str, object]:
    """Recall, false boxes and box errors of one way to find faces."""
    pairs, n_false, seconds = [], 0, 0.0
    for path, own in faces.items():
        image = read_photograph(path)
        started = time.process_time()
        found = find(image)
        seconds += time.process_time() - started
        n_false += sum(max(overlap(face, box) for face in own) < FALSE for box in found)
        for face in own:
            best = max(found, key=lambda box: overlap(face, box), default=None)
            if best is not None and overlap(face, best) > HIT:
                pairs.append((face, best))
    errors = np.array([_errors(face, box) for face, box in pairs])
    overlaps = [overlap(face, box) for face, box in pairs]
    total = sum(len(own) for own in faces.values())
    return {
        "faces": total,
        "found": len(pairs),
        "recall": round(len(pairs) / total, 3),
        "false_boxes": n_false,
        "overlap_median": round(float(np.median(overlaps)), 3),
        "overlap_lowest_tenth": round(float(np.percentile(overlaps, 10)), 3),
        "centre_error_percent": round(100 * float(np.linalg.norm(errors[:, :2], axis=1).mean()), 2),
        "size_error_percent": round(100 * float(np.abs(errors[:, 2]).mean()), 2),
        "bias_percent": {
            name: round(100 * float(value), 2)
            for name, value in zip(
                ("right", "down", "width", "height"), np.median(errors[:, [0, 1, 3, 4]], axis=0), strict=True
            )
        },
        "cpu_seconds_per_photograph": round(seconds / len(faces), 3),
    }


def _errors(face: FaceBox, box: FaceBox) -> list[float]:
    """Shift right and down, and what is too long, too wide and too high, as shares of the face's longer side."""
    shift = (box.centre - face.centre) / face.longer_side
    sizes = [box.longer_side - face.longer_side, box.width - face.width, box.height - face.height]
    return [*shift, *(size / face.longer_side for size in sizes)]


def refined(detector: Detector, predictor: Predictor) -> Finder:
    """The detector with its boxes refined by the network."""

    def find(image: ndarray) -> list[FaceBox]:
        faces = sure_faces(detector.candidates(image))
        return [face.box for face in refine_faces(image, faces, predictor, builtin_model())]

    return find


def main() -> None:
    """Measures and writes."""
    parser = options_parser(__doc__, Path("out/detection.json"))
    parser.add_argument("--faces", type=Path, required=True, help="annotated photographs, such as dlib's examples")
    parser.add_argument("--detectors", default=",".join(DETECTORS))
    parser.add_argument("--checkpoint", type=Path)
    options = parser.parse_args()
    photographs = annotated_photographs(options.faces)
    faces = {path: [box for box, _ in own] for path, own in photographs.items()}
    predictor = Predictor.load(options.checkpoint, "cpu") if options.checkpoint else None
    report: dict[str, object] = {}
    for name in options.detectors.split(","):
        detector = open_detector(name)
        report[name] = measure(detector.detect, faces)
        if predictor is not None:
            report[f"{name}, refined"] = measure(refined(detector, predictor), faces)
    write_report(report, options.out)


if __name__ == "__main__":
    main()
