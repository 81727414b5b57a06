"""What a face costs on one core, stage by stage: network and fit after it was detected, and a whole photograph.

    python -m tests.benchmarks.face [--checkpoint C] [--image photo.jpg] [--repeats 30] [--out face.json]

Processor time of one thread, the least and the median of all repeats. "steps_median_ms" divides the whole into the
functions that do most of the work; the time between them is not listed. The face is the largest that the detector finds
in the photograph (scikit-image's astronaut unless another is given); reading its file is not included. The fits are
those of `pix2face fit`: as it is, not held to the silhouette, and with the regularisation estimated.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from threadpoolctl import threadpool_limits

from pix2face.api import Pix2Face
from pix2face.files.images import read_photograph
from pix2face.fitting import face_fit, picture_measurement
from pix2face.fitting.fit_options import FitOptions
from pix2face.fitting.least_squares.linear_system import ImageSystem
from pix2face.fitting.silhouette import OutsideDistance
from pix2face.geometry.crops import crop_image, square_crop
from pix2face.inference import PACKAGED, predictor
from pix2face.inference.onnx_session import OnnxSession, keep_networks_in_one_thread
from tests.benchmarks.measuring import StepTimes, options_parser, processor_ms, write_report


def stages(faces: Pix2Face, image: UInt8[ndarray, "h w 3"]) -> dict[str, Callable[[], object]]:
    """The ways of one face, and the first step of them alone."""
    box = faces.find_faces(image)[0].box
    height, width = image.shape[:2]
    (prediction,) = faces.predict(image, [box])
    header = faces.predictor.header
    size_px = header.size_px

    def fit(**changes: Any) -> Callable[[], object]:
        return lambda: faces.fit_prediction(prediction, (height, width), FitOptions(**changes))

    return {
        "crop": lambda: crop_image(image, square_crop(box, header.crop_scale, size_px)),
        "crop and network": lambda: faces.predict(image, [box]),
        "fit": fit(),
        "fit, not held to the silhouette": fit(silhouette=False),
        "fit, regularisation estimated": fit(regularisation="estimate"),
        "all of it": lambda: faces.fit(image, [box]),
        "finding the faces of the photograph": lambda: faces.find_faces(image),
        "finding and fitting them": lambda: faces.fit(image),
    }


# The functions of each step, in the modules that call them.
STEPS: dict[str, Sequence[tuple[Any, str]]] = {
    "crop": [(predictor, "crop_image")],
    "network": [(OnnxSession, "run")],
    "planes to maps": [(predictor, "read_planes"), (predictor, "read_landmarks")],
    "choice of points": [
        (picture_measurement, name)
        for name in ("without_white_noise", "valid_pixel_values", "_clear_pixels", "correspondences")
    ],
    "localisation": [(picture_measurement, "localise_prepared")],
    "start of the camera": [(picture_measurement, "fit_affine_camera")],
    "coefficients": [(picture_measurement, "image_system"), (ImageSystem, "solve")],
    "distance from the mask": [(OutsideDistance, "of")],
    "rows of reprojection and silhouette": [
        (picture_measurement, "with_reprojection"),
        (picture_measurement, "with_silhouette"),
    ],
    "camera held to the silhouette, twice": [(picture_measurement, "fit_camera_to_silhouette")],
    "correction": [(picture_measurement, "_corrected")],
    "landmarks": [(face_fit, "face_of_coefficients")],
}


def step_milliseconds(run: Callable[[], object], repeats: int) -> dict[str, float]:
    """The median processor time of each step, without the steps that it calls itself."""
    times, rows = StepTimes(process_time), []
    with times.of((name, *function) for name, functions in STEPS.items() for function in functions):
        for _ in range(repeats + 1):
            times.seconds.clear()
            run()
            rows.append({name: sum(times.seconds[name]) for name in STEPS})
    return {name: round(1e3 * median(row[name] for row in rows[1:]), 2) for name in STEPS}


def milliseconds(run: Callable[[], object], repeats: int) -> dict[str, float]:
    """Least and median processor time."""
    (times,) = processor_ms({"run": run}, repeats).values()
    return {"least_ms": round(min(times), 2), "median_ms": round(median(times), 2)}


def astronaut() -> UInt8[ndarray, "h w 3"]:
    """A photograph that comes with a package of the tests."""
    from skimage import data

    return np.ascontiguousarray(data.astronaut())  # type: ignore[no-untyped-call]


def main() -> None:
    """Times one photograph's largest face and writes the JSON."""
    parser = options_parser(__doc__)
    parser.add_argument("--checkpoint", type=Path)
    parser.add_argument("--image", type=Path)
    parser.add_argument("--repeats", type=int, default=30)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    keep_networks_in_one_thread()
    checkpoint = options.checkpoint or PACKAGED
    faces = Pix2Face.load(checkpoint, device="cpu")
    image = read_photograph(options.image) if options.image else astronaut()
    with threadpool_limits(1):
        ways = stages(faces, image)
        rows = {name: milliseconds(run, options.repeats) for name, run in ways.items()}
        steps = step_milliseconds(ways["all of it"], options.repeats)
    header = faces.predictor.header
    report: dict[str, Any] = {
        "network": {"size_px": header.size_px, "architecture": header.architecture, "widths": list(header.widths)},
        "one_core": rows,
        "steps_median_ms": steps,
    }
    write_report(report, options.out)


if __name__ == "__main__":
    main()
