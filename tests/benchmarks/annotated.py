"""Landmark errors of the packaged network on any annotated photographs: 300-W's, dlib's, your own.

    python -m tests.benchmarks.annotated FOLDER [--checkpoint C] [--landmarks FILE] [--landmark-type 2d|3d]
        [--boxes truth|refined|detected] [--turned DEGREES] [--overlays DIR]

FOLDER is searched with all below it (.pts beside the picture, .mat of AFLW2000-3D, dlib's .xml). Errors are % of the
distance of the outer eye corners, of the 51 inner points. By default, points that were marked by hand are compared
with landmarks of the type 2d, and projections of a model (.mat) with those of the type 3d. ``refined`` starts from a
box that is a fifth too large and a tenth aside, and takes the landmarks of the first fit for the second box, as after
a detector. ``--turned`` turns the photographs anticlockwise about the middle of the face. Faces that would be taken for
false alarms in their true boxes, or are not found, are named.
"""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from pix2face import Pix2Face
from pix2face.detectors.protocol import overlap
from pix2face.face_files.annotations import find_annotations
from pix2face.files.images import read_photograph
from pix2face.fitting.fit_options import FitOptions
from pix2face.geometry.crops import FaceBox, centres_to_integers
from pix2face.geometry.landmark_metrics import landmark_errors
from pix2face.geometry.landmarks import IBUG68, INNER51
from pix2face.landmark_choice.landmark_file import with_landmarks
from pix2face.photographs.refined_detection import refined_boxes
from tests.benchmarks.measuring import options_parser, write_report

OVERLAY_PX = 320
LEAST_OVERLAP = 0.4


def main() -> None:
    """Measures every face and writes the JSON."""
    parser = options_parser(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--checkpoint", type=Path)
    parser.add_argument("--landmarks", type=Path, help="what `pix2face landmarks select` wrote")
    parser.add_argument("--landmark-type", choices=("2d", "3d"))
    parser.add_argument("--boxes", choices=("truth", "refined", "detected"), default="truth")
    parser.add_argument("--turned", type=float, default=0.0)
    parser.add_argument("--overlays", type=Path)
    options = parser.parse_args()
    faces, errors = Pix2Face.load(options.checkpoint, device="cpu"), {}
    refuted, not_found = [], []
    if options.landmarks is not None:
        faces = Pix2Face(faces.predictor, with_landmarks(faces.model, options.landmarks))
    expected: list[float] = []
    for annotation in find_annotations(options.folder, IBUG68):
        annotated = annotation.load()
        true, image = annotated.landmarks2d, read_photograph(annotated.image_path)
        if not np.isfinite(true).all():
            continue
        if options.turned:
            image, true = _turned(image, true, options.turned)
        box = FaceBox.around(true)
        (seen,) = refined_boxes([(image, box)], faces.predictor, faces.model)
        if seen is None or seen.is_refuted:
            refuted.append(annotation.name)
        if seen is not None:
            expected.append(seen.expected_error or 0.0)
        if options.boxes != "truth":
            found = _refined(faces, image, box) if options.boxes == "refined" else _detected(faces, image, box)
            if found is None:
                not_found.append(annotation.name)
                continue
            box = found
        landmark_type = options.landmark_type or ("2d" if annotated.follows_outline else "3d")
        (fit,) = faces.fit(image, [box], FitOptions(landmark_type=landmark_type))
        own = landmark_errors(fit.landmarks2d, true, "outer-eye")
        errors[annotation.name] = float(own[list(INNER51)].mean())
        if options.overlays:
            options.overlays.mkdir(parents=True, exist_ok=True)
            _write_overlay(options.overlays / f"{annotation.name.replace('/', '_')}.jpg", image, fit.landmarks2d, true)
    percent = 100 * np.array(list(errors.values()))
    report = {
        "faces": len(percent),
        "median": round(float(np.median(percent)), 2),
        "mean": round(float(percent.mean()), 2),
        "above 10 %": round(100 * float((percent > 10).mean()), 1),
        "not found": not_found,
        "refuted as no faces": refuted,
        "largest expected error in their true boxes": round(max(expected, default=0.0), 3),
        "each": {name: round(100 * error, 2) for name, error in sorted(errors.items(), key=lambda item: -item[1])},
    }
    write_report(report, options.out)


def _refined(faces: Pix2Face, image: UInt8[ndarray, "h w 3"], box: FaceBox) -> FaceBox:
    """The box of a fit in a box that is a fifth too large, and a tenth too far to the right and down."""
    half, centre = 0.6 * np.array([box.width, box.height]), box.centre + 0.1 * box.longer_side
    (first,) = faces.fit(image, [FaceBox(*(centre - half).tolist(), *(centre + half).tolist())])
    return FaceBox.around(first.landmarks2d)


def _detected(faces: Pix2Face, image: UInt8[ndarray, "h w 3"], box: FaceBox) -> FaceBox | None:
    found = [face.box for face in faces.find_faces(image) if overlap(face.box, box) >= LEAST_OVERLAP]
    return max(found, key=lambda own: overlap(own, box), default=None)


def _turned(
    image: UInt8[ndarray, "h w 3"], points: Float64[ndarray, "68 2"], degrees: float
) -> tuple[UInt8[ndarray, "s s 3"], Float64[ndarray, "68 2"]]:
    """Turns a photograph about the middle of a face, which becomes the middle of a square of the same size."""
    side = max(image.shape[:2])
    centre = FaceBox.around(points).centre
    turn = cv2.getRotationMatrix2D((float(centre[0]), float(centre[1])), degrees, 1)
    turn[:, 2] += side / 2 - centre
    return cv2.warpAffine(image, centres_to_integers(turn), (side, side)), points @ turn[:, :2].T + turn[:, 2]


def _write_overlay(path: Path, image: ndarray, found: Float64[ndarray, "68 2"], true: Float64[ndarray, "68 2"]) -> None:
    box = FaceBox.around(true)
    scale = OVERLAY_PX / (1.6 * box.longer_side)
    shift = OVERLAY_PX / 2 - scale * box.centre
    picture = cv2.warpAffine(image, np.column_stack([scale * np.eye(2), shift]), (OVERLAY_PX, OVERLAY_PX))
    for points, colour in ((true, (60, 220, 60)), (found, (255, 40, 40))):
        for x, y in scale * points + shift:
            cv2.circle(picture, (round(x), round(y)), 2, colour, -1)
    cv2.imwrite(str(path), picture[..., ::-1])


if __name__ == "__main__":
    main()
