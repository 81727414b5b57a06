"""How long the parts of a fit take on one thread, and what fewer vertices cost in error.

    python -m tests.benchmarks.fitting [--repeats 30] [--out out/fitting.json]

Times are the least of all repeats, in processor time of the one thread. A matrix product of a fixed size is timed in
the same run, alternately, so that figures of two machines can be compared. Errors are those of the noisy closed loop
(1 mm, 5 % gross outliers) with lambda estimated, means over 12 faces.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from pix2face.fitting.cameras.camera_fit import fit_weak_perspective_camera
from pix2face.fitting.face_fit import face_of_coefficients, fit_face
from pix2face.fitting.fit_options import PREDICTED_MAPS_REGULARISATION
from pix2face.fitting.least_squares.linear_system import PREDICTED_MAPS_ROUNDS, image_system
from pix2face.fitting.localise import localise_prepared, valid_pixel_values
from pix2face.fitting.noise import estimated_regularisation, white_noise_mm
from pix2face.fitting.picture_measurement import (
    CAMERA_PIXELS,
    COEFFICIENT_VERTICES,
    PREDICTED_MAPS_VERTICES,
    correspondences,
)
from pix2face.fitting.prepared_model import prepared_model
from pix2face.models.morphable_model import MorphableModel
from tests.benchmarks.closed_loop import MODELS, known_face, measure, summary
from tests.benchmarks.measuring import options_parser, processor_ms, write_report
from tests.fits import paper_fit

VERTEX_COUNTS = (600, 1250, COEFFICIENT_VERTICES, 5000, 10_000)
REGULARISATION = PREDICTED_MAPS_REGULARISATION


def parts(model: MorphableModel) -> dict[str, Callable[[], object]]:
    """The steps of ``fit_face`` on one face (lambda given, as of predicted maps), each on what the one before found."""
    maps = known_face(model, 3, perspective=False).maps
    width = maps.mask.shape[1]
    prepared, pixels = prepared_model(model, PREDICTED_MAPS_VERTICES), valid_pixel_values(maps)
    points3d, points2d = correspondences(pixels, np.arange(len(pixels.places)), width, CAMERA_PIXELS)
    camera = fit_weak_perspective_camera(points3d, points2d, robust=True)
    found = localise_prepared(maps, pixels, prepared)
    basis = prepared.basis[found.places]
    exact = basis.astype(np.float64)
    system = image_system(basis, found.offsets, REGULARISATION, robust_rounds=PREDICTED_MAPS_ROUNDS)
    c, k = system.solve(REGULARISATION), model.n_identity
    return {
        "white noise and valid pixels": lambda: (white_noise_mm(maps), valid_pixel_values(maps)),
        "camera: weak perspective, robust": lambda: fit_weak_perspective_camera(
            *correspondences(pixels, np.arange(len(pixels.places)), width, CAMERA_PIXELS), robust=True
        ),
        "localisation (Eq. 2)": lambda: localise_prepared(maps, pixels, prepared),
        "coefficients (Eq. 4), robust": lambda: image_system(
            prepared.basis[found.places], found.offsets, REGULARISATION, robust_rounds=PREDICTED_MAPS_ROUNDS
        ).solve(REGULARISATION),
        "landmarks": lambda: face_of_coefficients(model, camera, c[:k], c[k:]),
        "together (fit_face)": lambda: fit_face(maps, model, paper_fit(regularisation=REGULARISATION)),
        "the same, held to the silhouette": lambda: fit_face(
            maps, model, paper_fit(regularisation=REGULARISATION, silhouette=True)
        ),
        "not in it: estimating lambda": lambda: estimated_regularisation(
            system, exact, found.offsets, prepared.patches[found.places]
        ),
        "not in it: the mesh": lambda: model.vertices(c[None, :k], c[None, k:]),
        "not in it: all, lambda estimated": lambda: fit_face(maps, model, paper_fit()),
        "not in it: all, pinhole": lambda: fit_face(
            maps, model, paper_fit(camera="pinhole", regularisation=REGULARISATION)
        ),
        "not in it: all, camera auto": lambda: fit_face(
            maps, model, paper_fit(camera="auto", regularisation=REGULARISATION)
        ),
    }


def least_ms(functions: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """The least processor time of each function in milliseconds."""
    return {name: round(min(times), 3) for name, times in processor_ms(functions, repeats).items()}


def subsets(model: MorphableModel, n_faces: int, repeats: int) -> list[dict[str, float]]:
    """Time and error for some numbers of vertices."""
    out = []
    for count in VERTEX_COUNTS:
        maps = known_face(model, 3, perspective=False).maps

        def fit(count: int = count) -> object:
            return fit_face(maps, model, paper_fit(regularisation=REGULARISATION), n_vertices=count)  # noqa: B023

        errors = summary(
            measure(model, n_faces, lambda _, own, n=count: fit_face(own, model, paper_fit(), n_vertices=n), 1.0, 0.05)
        )
        out.append(
            {"vertices": count, "ms": least_ms({"fit": fit}, repeats)["fit"]}
            | {
                name: round(errors[name]["mean"], 4)
                for name in ("visible_landmarks_percent", "occluded_landmarks_percent", "visible_vertices_mean_mm")
            }
        )
    return out


def main() -> None:
    """Measures and writes."""
    parser = options_parser(__doc__, Path("out/fitting.json"))
    parser.add_argument("--repeats", type=int, default=30)
    parser.add_argument("--faces", type=int, default=12)
    options = parser.parse_args()
    square = np.random.default_rng(0).standard_normal((1500, 1500))
    report: dict[str, object] = {}
    with threadpool_limits(1):
        for name, make in MODELS.items():
            model = make()
            functions = parts(model) | {"reference: 1500 x 1500 product": lambda: square @ square}
            report[name] = {
                "vertices": len(model.mean),
                "coefficients": model.n_identity + model.n_expression,
                "milliseconds": least_ms(functions, options.repeats),
                "subsets": subsets(model, options.faces, options.repeats),
            }
    write_report(report, options.out)


if __name__ == "__main__":
    main()
