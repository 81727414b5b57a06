"""Quantities that are given at the corners of triangles and interpolated over the face: a line of ATTRIBUTES each.

The OpenGL renderer and the oracle both go by this table.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np
from jaxtyping import Float, Float32, Float64, Int, Int32
from numpy import ndarray
from scipy import sparse

from pix2face.errors import UsageError
from pix2face.geometry.camera import Camera, nearest_weak_perspective, pinhole_of
from pix2face.models.morphable_model import MorphableModel

Values = Callable[[MorphableModel, Float32[ndarray, "v 3"], Camera], Float32[ndarray, "n c"]]


@final
@dataclass(frozen=True)
class Attribute:
    """Something to interpolate."""

    n_channels: int
    values: Values  # of one face as one camera sees it
    corners: Callable[[MorphableModel], Int32[ndarray, "t 3"]]  # for each triangle the rows of its values
    is_direction: bool = False  # unit vectors, which interpolation brings back to length 1
    same_for_all: bool = False  # depends on the model alone


def camera_from_model_axes(camera: Camera) -> Float64[ndarray, "3 3"]:
    """The orthogonal matrix nearest to what a camera does to directions (determinant -1 where it mirrors)."""
    if not camera.is_affine:
        return pinhole_of(camera).rotation
    axes = nearest_weak_perspective(camera).rotation.copy()
    axes[2] *= np.sign(axes[2] @ camera.matrix[2, :3])
    return axes


def vertex_normals(vertices: Float[ndarray, "v 3"], triangles: Int[ndarray, "t 3"]) -> Float64[ndarray, "v 3"]:
    """Unit normals, the mean of the triangles' at each vertex weighted by area; 0 where no triangle is."""
    corners = vertices[triangles].astype(np.float64)
    normals = np.repeat(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), 3, axis=0)
    columns = [np.bincount(triangles.ravel(), normals[:, axis], minlength=len(vertices)) for axis in range(3)]
    total = np.stack(columns, axis=1)
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(total / np.where(lengths > 0, lengths, 1), dtype=np.float64)


def facing(vertices: Float[ndarray, "v 3"], triangles: Int[ndarray, "t 3"], camera: Camera) -> Float64[ndarray, " v"]:
    """How much each vertex faces the viewer: the cosine between its normal and the direction towards the camera."""
    towards = -camera.matrix[2, :3] / np.linalg.norm(camera.matrix[2, :3])
    return np.asarray(vertex_normals(vertices, triangles) @ towards, dtype=np.float64)


def normals_in_camera(
    model: MorphableModel, vertices: Float32[ndarray, "v 3"], camera: Camera
) -> Float32[ndarray, "v 3"]:
    """Smooth unit normals of this face, outward, camera frame (x right, y down, z forward)."""
    a, b, c = (vertices[model.triangles[:, k]] for k in range(3))
    normals = _incidence(model) @ np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = normals / np.where(length > 0, length, 1)
    return np.asarray(unit @ camera_from_model_axes(camera).T, dtype=np.float32)


def check_layers(model: MorphableModel, layers: Sequence[str]) -> None:
    """Refuses layers that no face of a model can have, before any is drawn.

    Raises:
        UsageError: The model has not what a layer needs.
    """
    if "uv" in layers and (model.uv is None or model.uv_triangles is None):
        raise UsageError(
            f"expected a model with texture coordinates for the layer uv, found {model.name} without; leave uv out of "
            "--layers or choose another --model"
        )


def texture_coordinates(model: MorphableModel, _: Float32[ndarray, "v 3"], __: Camera) -> Float32[ndarray, "u 2"]:
    """The model's; raises UsageError where it has none."""
    check_layers(model, ("uv",))
    assert model.uv is not None
    return model.uv


@lru_cache(maxsize=2)
def split_at_seams(
    model: MorphableModel,
) -> tuple[Int[ndarray, " n"], Float64[ndarray, "n 2"], Int[ndarray, "t 3"]]:
    """Splits vertices so that each has one texture coordinate; those without a triangle are left out.

    Returns the model's vertex of each, its texture coordinate, and the triangles over them.

    Raises:
        UsageError: The model has no texture coordinates.
    """
    if model.uv is None or model.uv_triangles is None:
        raise UsageError(f"expected texture coordinates in the model {model.name!r}, found none")
    # One number for each pair, because NumPy sorts pairs ten times as slowly.
    pairs = model.triangles.ravel().astype(np.int64) * len(model.uv) + model.uv_triangles.ravel()
    unique, triangles = np.unique(pairs, return_inverse=True)
    vertex, own_uv = np.divmod(unique, len(model.uv))
    split = vertex, model.uv[own_uv].astype(np.float64), triangles.reshape(-1, 3)
    for shared in split:
        shared.flags.writeable = False
    return split


# A new layer of something known at vertices is one line here (and one in shards/layers.py, so that shards take it).
ATTRIBUTES: Mapping[str, Attribute] = {
    "normals": Attribute(3, normals_in_camera, lambda model: model.triangles, is_direction=True),
    "uv": Attribute(
        2,
        texture_coordinates,
        lambda model: model.triangles if model.uv_triangles is None else model.uv_triangles,
        same_for_all=True,
    ),
}
REGIONS = "regions"
EXTRA_LAYERS = (*ATTRIBUTES, REGIONS)


@lru_cache(maxsize=2)
def _incidence(model: MorphableModel) -> sparse.csr_array:
    """Which triangles (columns) meet in which vertex (rows)."""
    corner, triangle = model.triangles.reshape(-1), np.repeat(np.arange(len(model.triangles)), 3)
    ones = np.ones(len(corner), dtype=np.float32)
    return sparse.csr_array((ones, (corner, triangle)), shape=(len(model.mean), len(model.triangles)))
