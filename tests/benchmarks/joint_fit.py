"""One person in 1 to 100 pictures: time for each picture, and how far the identity is off.

    python -m tests.benchmarks.joint_fit [--people 3] [--out out/joint_fit.json]

Pictures: another expression and view in each (yaw to 60 degrees), errors of 1.5 mm in the offsets that are alike over
32 x 32 pixels, as a network makes them. Two kinds of errors: new ones in each picture ("new"), and those of one
picture in all of the same person ("lasting": a network's bias). Rendered by the NumPy rasteriser. The identity error
is the root mean square over the coefficients, in standard deviations: all, those ten that move the face most, and the
root mean square distance of the vertices of the face, in mm.
"""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from pix2face.fitting.joint_fit import fit_joint
from pix2face.geometry.camera import HeadPose
from pix2face.geometry.maps import FaceMaps
from pix2face.models.morphable_model import MorphableModel, builtin_model
from tests.benchmarks.measuring import options_parser, write_report
from tests.fits import paper_fit
from tests.pix2face.fitting.rendered_faces import SIZE_PX, KnownFace, render_known_face

COUNTS = (1, 3, 10, 30, 100)
PATCH_PX = 32
NOISE_MM = 1.5


def pictures(model: MorphableModel, person: int, count: int) -> list[KnownFace]:
    """Pictures of one person."""
    out = []
    for index in range(count):
        rng = np.random.default_rng([9, person, index])
        pose = HeadPose(rng.uniform(-15, 15), rng.uniform(-60, 60), rng.uniform(-15, 15))
        seed = 100_000 + 1000 * person + index
        out.append(render_known_face(model, pose, seed, perspective=False, identity_seed=person))
    return out


def with_patches(maps: FaceMaps, model: MorphableModel, seed: tuple[int, ...], *, lasting: bool) -> FaceMaps:
    """Adds errors that are alike over patches: of the picture, or (lasting) of the face."""
    rng = np.random.default_rng(seed)
    if lasting:
        cells = np.floor(maps.pncc / PATCH_PX).astype(int) % 16
        noise = rng.normal(0, NOISE_MM, (16, 16, 16, 3))[cells[..., 0], cells[..., 1], cells[..., 2]]
    else:
        side = -(-SIZE_PX // PATCH_PX)
        noise = np.kron(rng.normal(0, NOISE_MM, (side, side, 3)), np.ones((PATCH_PX, PATCH_PX, 1)))
    return replace(maps, offset=((maps.offset + noise) * maps.mask[..., None]).astype(np.float32))


def identity_errors(model: MorphableModel, found: np.ndarray, true: np.ndarray) -> dict[str, float]:
    """Of one estimate."""
    difference = found - true
    reach = np.linalg.norm(model.identity_basis.reshape(model.n_identity, -1), axis=1)
    largest = np.argsort(-reach)[:10]
    shift = np.tensordot(difference, model.identity_basis[:, model.is_face_vertex], axes=1)
    return {
        "coefficients_rms": float(np.sqrt(np.mean(difference**2))),
        "ten_largest_rms": float(np.sqrt(np.mean(difference[largest] ** 2))),
        "vertices_rms_mm": float(np.sqrt((shift**2).sum(axis=1).mean())),
    }


def main() -> None:
    """Measures and writes."""
    parser = options_parser(__doc__, Path("out/joint_fit.json"))
    parser.add_argument("--people", type=int, default=3)
    options = parser.parse_args()
    model = builtin_model()
    errors: dict[str, dict[int, list[dict[str, float]]]] = {
        kind: {n: [] for n in COUNTS} for kind in ("new", "lasting")
    }
    times: dict[int, list[float]] = {n: [] for n in COUNTS}
    with threadpool_limits(1):
        for person in range(options.people):
            seen = pictures(model, person, max(COUNTS))
            for kind in errors:
                maps = [
                    with_patches(
                        face.maps,
                        model,
                        (5, person) if kind == "lasting" else (6, person, i),
                        lasting=kind == "lasting",
                    )
                    for i, face in enumerate(seen)
                ]
                for n in COUNTS:
                    for _ in range(3 if n < 30 else 1):
                        started = time.process_time()
                        found = fit_joint(maps[:n], model, paper_fit())
                        times[n].append((time.process_time() - started) / n)
                    errors[kind][n].append(identity_errors(model, found[0].identity, seen[0].identity))
    report = {
        "people": options.people,
        "milliseconds_a_picture": {n: round(1e3 * float(np.median(own)), 2) for n, own in times.items()},
        "identity_error": {
            kind: {
                n: {name: round(float(np.mean([e[name] for e in own])), 4) for name in own[0]}
                for n, own in by_n.items()
            }
            for kind, by_n in errors.items()
        },
    }
    write_report(report, options.out)


if __name__ == "__main__":
    main()
