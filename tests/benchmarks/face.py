"""What a face costs after it was detected: network and fit on one core, stage by stage.

    python -m tests.benchmarks.face [--checkpoint C] [--image photo.jpg] [--repeats 30] [--out face.json]

Processor time of one thread, the least and the median of all repeats. The face is the largest that the detector finds
in the photograph (scikit-image's astronaut unless another is given); to find it is not in the figures. The fits are
those of `pix2face fit`: as it is, not held to the silhouette, and with the regularisation estimated.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import UInt8
from numpy import ndarray
from threadpoolctl import threadpool_limits

from pix2face.api import Pix2Face
from pix2face.files.images import read_photograph
from pix2face.fitting.fit_options import FitOptions
from pix2face.geometry.crops import crop_image, square_crop
from pix2face.inference import PACKAGED
from tests.benchmarks.surroundings import surroundings, write_report


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
    }


def milliseconds(run: Callable[[], object], repeats: int) -> dict[str, float]:
    """Least and median processor time, after one call that is not counted."""
    run()
    times = []
    for _ in range(repeats):
        began = process_time()
        run()
        times.append(1e3 * (process_time() - began))
    return {"least_ms": round(min(times), 2), "median_ms": round(median(times), 2)}


def astronaut() -> UInt8[ndarray, "h w 3"]:
    """A photograph that comes with a package of the tests."""
    from skimage import data

    return np.ascontiguousarray(data.astronaut())  # type: ignore[no-untyped-call]


def main() -> None:
    """Times one photograph's largest face and writes the JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkpoint", type=Path)
    parser.add_argument("--image", type=Path)
    parser.add_argument("--repeats", type=int, default=30)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    checkpoint = options.checkpoint or PACKAGED
    faces = Pix2Face.load(checkpoint, device="cpu")
    image = read_photograph(options.image) if options.image else astronaut()
    with threadpool_limits(1):
        rows = {name: milliseconds(run, options.repeats) for name, run in stages(faces, image).items()}
    header = faces.predictor.header
    report: dict[str, Any] = {
        **surroundings(),
        "network": {"size_px": header.size_px, "architecture": header.architecture, "widths": list(header.widths)},
        "one_core": rows,
    }
    write_report(report, options.out)


if __name__ == "__main__":
    main()
