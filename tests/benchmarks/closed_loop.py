"""Known faces -> maps -> fit: how much comes back, from exact maps and from noisy ones with gross outliers.

    python -m tests.benchmarks.closed_loop [--model builtin|full-size] [--faces 200] [--noise-mm 0] [--outliers 0]
                                           [--camera weak-perspective|pinhole|affine|auto] [--out FILE.json]

Faces: all coefficients drawn from the unit normal (cut at 2.5), yaw to 80 degrees, pitch and roll to 20, 256 px,
rendered by the NumPy rasteriser and coded as shards are. Every error is given as mean, 95th percentile and largest over
faces. Landmarks are in % of the eye distance (3D distance of the outer corners x scale), the mean over the landmarks of
one face being one number.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy import ndarray

from pix2face.fitting.face_fit import FaceFit, fit_face
from pix2face.fitting.picture_measurement import COEFFICIENT_VERTICES
from pix2face.geometry.camera import HeadPose, pinhole_of
from pix2face.geometry.maps import FaceMaps
from pix2face.models.morphable_model import MorphableModel, builtin_model
from tests.benchmarks.measuring import options_parser, write_report
from tests.fits import paper_fit
from tests.full_size_model import full_size_model
from tests.pix2face.fitting.rendered_faces import KnownFace, render_known_face

MODELS = {"builtin": builtin_model, "full-size": full_size_model}


def known_face(model: MorphableModel, index: int, *, perspective: bool) -> KnownFace:
    """The face of an index: yaw to 80 degrees."""
    rng = np.random.default_rng([7, index])
    pose = HeadPose(rng.uniform(-20, 20), rng.uniform(-80, 80), rng.uniform(-20, 20))
    return render_known_face(model, pose, 1000 + index, perspective=perspective)


def with_noise(maps: FaceMaps, model: MorphableModel, noise_mm: float, outliers: float, seed: int) -> FaceMaps:
    """White noise on both maps; some pixels show another point of the face and a random offset."""
    rng = np.random.default_rng([8, seed])
    shape = maps.pncc.shape
    pncc, offset = (values + noise_mm * rng.standard_normal(shape) for values in (maps.pncc, maps.offset))
    wrong = (rng.uniform(size=maps.mask.shape) < outliers) & maps.mask
    elsewhere = model.mean[model.is_face_vertex]
    pncc[wrong] = elsewhere[rng.integers(len(elsewhere), size=int(wrong.sum()))]
    offset[wrong] = rng.normal(0, 10, (int(wrong.sum()), 3))
    pncc[~maps.mask], offset[~maps.mask] = 0, 0
    return replace(maps, pncc=pncc.astype(np.float32), offset=offset.astype(np.float32))


def errors_of(face: KnownFace, fit: FaceFit, model: MorphableModel) -> dict[str, float]:
    """Errors of one fit."""
    visible = face.is_visible(model)
    seen = visible[model.landmarks["ibug68"]]
    percent = 100 / face.eye_distance_px(model)
    landmarks = percent * np.linalg.norm(fit.landmarks2d - face.landmarks2d(model), axis=1)
    pixels = (fit.camera.project(fit.vertices[visible]) - face.camera.project(face.vertices[visible])) ** 2
    distances = np.linalg.norm(fit.vertices[visible] - face.vertices[visible], axis=1)
    errors = {
        "reprojection_rms_px": float(np.sqrt(pixels.sum(axis=1).mean())),
        "visible_landmarks_percent": float(landmarks[seen].mean()),
        "visible_vertices_mean_mm": float(distances.mean()),
        "visible_vertices_95_percent_within_mm": float(np.percentile(distances, 95)),
        "visible_vertices_beyond_0.1_mm_percent": 100 * float((distances > 0.1).mean()),
        "visible_vertices_largest_mm": float(distances.max()),
        "coefficients_rms": float(np.sqrt(np.mean((fit.identity - face.identity) ** 2))),
    }
    if not seen.all():
        errors["occluded_landmarks_percent"] = float(landmarks[~seen].mean())
    if not face.camera.is_affine and not fit.camera.is_affine:
        errors["focal_length_percent"] = 100 * abs(
            pinhole_of(fit.camera).focal_px / pinhole_of(face.camera).focal_px - 1
        )
    return errors


def measure(
    model: MorphableModel,
    n_faces: int,
    fit: Callable[[KnownFace, FaceMaps], FaceFit],
    noise_mm: float = 0,
    outliers: float = 0,
    *,
    perspective: bool = False,
) -> list[dict[str, float]]:
    """Errors of each face."""
    out = []
    for index in range(n_faces):
        face = known_face(model, index, perspective=perspective)
        maps = with_noise(face.maps, model, noise_mm, outliers, index) if noise_mm or outliers else face.maps
        out.append(errors_of(face, fit(face, maps), model))
    return out


def summary(errors: list[dict[str, float]]) -> dict[str, dict[str, float]]:
    """Mean, 95th percentile and largest over the faces that have the figure."""
    names = sorted({name for face in errors for name in face})
    columns: dict[str, ndarray] = {name: np.array([face[name] for face in errors if name in face]) for name in names}
    return {
        name: {
            "mean": float(values.mean()),
            "95_percent_below": float(np.percentile(values, 95)),
            "largest": float(values.max()),
            "faces": len(values),
        }
        for name, values in columns.items()
    }


def main() -> None:
    """Measures and writes."""
    parser = options_parser(__doc__)
    parser.add_argument("--model", choices=sorted(MODELS), default="builtin")
    parser.add_argument("--faces", type=int, default=200)
    parser.add_argument(
        "--camera", choices=("affine", "weak-perspective", "pinhole", "auto"), default="weak-perspective"
    )
    parser.add_argument("--noise-mm", type=float, default=0.0)
    parser.add_argument("--outliers", type=float, default=0.0)
    parser.add_argument("--regularisation", type=float, default=None, help="lambda in mm^2; left out: estimated")
    parser.add_argument("--vertices", type=int, default=COEFFICIENT_VERTICES, help="how many vertices to look for")
    parser.add_argument("--constraints", choices=("vertices", "surface"), default="vertices")
    options = parser.parse_args()
    model = MODELS[options.model]()
    regularisation = options.regularisation or "estimate"

    def fit(face: KnownFace, maps: FaceMaps) -> FaceFit:
        return fit_face(
            maps,
            model,
            paper_fit(camera=options.camera, regularisation=regularisation),
            principal_point_px=face.principal_point_px,
            n_vertices=options.vertices,
            constraints=options.constraints,
        )

    errors = measure(
        model, options.faces, fit, options.noise_mm, options.outliers, perspective=options.camera == "pinhole"
    )
    chosen = {name: str(value) for name, value in vars(options).items() if name != "out"}
    write_report({"options": chosen, "errors": summary(errors)}, options.out)


if __name__ == "__main__":
    main()
