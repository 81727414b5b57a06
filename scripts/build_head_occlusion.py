"""Computes the share of ambient light that reaches each vertex of the built-in model.

    python -m scripts.build_head_occlusion [--output datagen/assets/head_occlusion.h5]

The share is the cosine-weighted mean of the vertex's visibility over directions on the sphere. A vertex is visible from
a direction if it is not behind the depth map drawn from there. The inside of the mouth is computed with an open jaw. An
ellipse below the neck, where the model ends, replaces shoulders and chest.
"""

import argparse
from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from datagen.appearance.light.harmonics import fibonacci_sphere
from datagen.appearance.scene import Surface
from datagen.opengl.gl_context import create_gl_context
from datagen.rendering.renderer import Renderer
from pix2face.geometry.camera import WeakPerspective, weak_perspective_camera
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.models.rasterise import SURFACE_DEPTH

TARGET = Path(__file__).parents[1] / "datagen" / "assets" / "head_occlusion.h5"
MAP_PX, N_DIRECTIONS = 512, 384
# Tolerance of the visibility, for slopes within a pixel and noise: depth bias, and offset of vertices along normals.
BIAS_MM, NORMAL_OFFSET_MM = 0.8, 0.7
INSIDE_MOUTH, LIPS = ("mouth_inside", "teeth", "tongue"), ("lips",)
JAW_OPEN = 0.8
# Smallest share of front teeth, which are more visible between parted lips than with this expression, and the distance
# into the mouth over which it falls by a factor of e.
FRONT_TEETH, INTO_MOUTH_MM = 0.6, 14.0
# Shoulders and chest: a flat ellipse below the neck (mm, model frame), and its albedo.
BODY_HEIGHT, BODY_CENTRE_Z, BODY_HALF_WIDTH, BODY_HALF_DEPTH, BODY_RETURNS = -135.0, -25.0, 210.0, 125.0, 0.3


def main() -> None:
    """Writes the file and prints percentiles by region."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=TARGET)
    options = parser.parse_args()
    model = builtin_model()
    renderer = Renderer(model, MAP_PX, MAP_PX, create_gl_context())
    closed = openness(model, model.mean, renderer)
    jaw_open = JAW_OPEN * model.named_expressions["jawOpen"]
    vertices = model.vertices(np.zeros((1, model.n_identity), dtype=np.float32), jaw_open[None])[0]
    opened = openness(model, vertices, renderer)
    behind_lips = model.mean[_is_of(model, LIPS), 2].max() - model.mean[:, 2]
    inside = np.maximum(opened, FRONT_TEETH * np.exp(-np.maximum(behind_lips, 0) / INTO_MOUTH_MM))
    found = np.where(_is_of(model, INSIDE_MOUTH), inside, np.where(_is_of(model, LIPS), (closed + opened) / 2, closed))
    smooth = _smoothed(model, found)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(options.output, "w", libver="v110") as file:
        file.attrs["model_sha256"] = model.sha256
        file.attrs["origin"] = "computed from the built-in model"
        stored = np.clip(np.rint(smooth * 255), 0, 255).astype(np.uint8)
        file.create_dataset("occlusion", data=stored, compression="gzip", track_times=False)
    print(f"{options.output}: {options.output.stat().st_size / 1e3:.0f} kB")
    for name in model.region_names:
        of_region = smooth[model.vertices_of(name)]
        print(f"  {name:12s} {np.percentile(of_region, [5, 50, 95]).round(2)}")


def openness(model: MorphableModel, vertices: Float32[ndarray, "v 3"], renderer: Renderer) -> Float64[ndarray, " v"]:
    """Returns the share of light from a uniform sky that reaches each vertex."""
    normals = Surface(model).normals(vertices).astype(np.float64)
    raised = vertices.astype(np.float64) + NORMAL_OFFSET_MM * normals
    seen, whole = np.zeros((2, len(vertices)))
    for direction in fibonacci_sphere(N_DIRECTIONS):
        cosine = np.maximum(normals @ direction, 0)
        seen += cosine * _is_seen(vertices, raised, direction, renderer) * _past_body(vertices, direction)
        whole += cosine
    return seen / np.maximum(whole, 1e-9)


def _is_seen(
    vertices: Float32[ndarray, "v 3"], raised: Float64[ndarray, "v 3"], direction: ndarray, renderer: Renderer
) -> ndarray:
    across = np.cross(np.eye(3)[np.abs(direction).argmin()], direction)
    across /= np.linalg.norm(across)
    rotation = np.stack([across, np.cross(-direction, across), -direction])
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    scale = 0.47 * MAP_PX / float(np.linalg.norm(vertices - centre, axis=1).max())
    middle = np.full(2, MAP_PX / 2) - scale * (rotation @ centre)[:2]
    camera = weak_perspective_camera(WeakPerspective(scale, rotation, middle))
    depth = renderer.render(vertices, camera)[SURFACE_DEPTH]
    column, row = np.clip(np.floor(camera.project(raised)), 0, MAP_PX - 1).astype(int).T
    return camera.depth(raised) <= depth[row, column] + BIAS_MM


def _past_body(vertices: Float32[ndarray, "v 3"], direction: ndarray) -> ndarray:
    """Returns the light from a direction at each vertex: less than 1 if the body is in between."""
    if direction[1] >= -1e-6:
        return np.ones(len(vertices))
    hit = vertices + ((BODY_HEIGHT - vertices[:, 1]) / direction[1])[:, None] * direction
    across, along = hit[:, 0] / BODY_HALF_WIDTH, (hit[:, 2] - BODY_CENTRE_Z) / BODY_HALF_DEPTH
    return np.where(across**2 + along**2 < 1, BODY_RETURNS, 1.0)


def _is_of(model: MorphableModel, regions: tuple[str, ...]) -> ndarray:
    chosen = np.zeros(len(model.mean), dtype=bool)
    chosen[model.vertices_of(*regions)] = True
    return chosen


def _smoothed(model: MorphableModel, values: Float64[ndarray, " v"]) -> Float64[ndarray, " v"]:
    """Averages values with the mean of their neighbours, to reduce the noise of single directions."""
    total, count = np.zeros((2, len(values)))
    for first, second in ((0, 1), (1, 2), (2, 0)):
        a, b = model.triangles[:, first], model.triangles[:, second]
        np.add.at(total, a, values[b])
        np.add.at(total, b, values[a])
        np.add.at(count, a, 1)
        np.add.at(count, b, 1)
    return 0.5 * values + 0.5 * total / np.maximum(count, 1)


if __name__ == "__main__":
    main()
