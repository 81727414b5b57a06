"""Measures how much of a face accessories leave visible."""

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, UInt8
from numpy import ndarray

from datagen.appearance.scene import PosedHead, SceneMesh, Surface
from datagen.appearance.solids import Solid, joined
from pix2face.models.morphable_model import builtin_model

VIEWS_DEG = (-45.0, 0.0, 45.0)
_PIXELS, _SPAN_MM = 40, 300.0
_FACE_DEPTH_MM = 45.0  # triangles nearer to the camera are in front of the face


@lru_cache(maxsize=1)
def mean_head() -> PosedHead:
    """Returns the mean of the built-in model as a head."""
    model = builtin_model()
    return PosedHead(model=model, vertices=model.mean, normals=Surface(model).normals(model.mean), neutral=model.mean)


def visible_share(meshes: Sequence[SceneMesh]) -> float:
    """Returns the smallest visible share of the mean face behind meshes, over the yaws of `VIEWS_DEG`.

    Meshes that let light through (lattices, lace, clear lenses) are ignored.
    """
    opaque = [mesh for mesh in meshes if not _lets_through(mesh)]
    if not opaque:
        return 1.0
    whole = joined([Solid(mesh.vertices, mesh.triangles, mesh.uv, mesh.normals) for mesh in opaque])
    shares = []
    for yaw_deg in VIEWS_DEG:
        axes, face = _view(yaw_deg)
        hidden = _drawn(whole.vertices, whole.triangles, axes, _FACE_DEPTH_MM)
        shares.append(1 - float((face & hidden).sum()) / float(face.sum()))
    return min(shares)


def _lets_through(mesh: SceneMesh) -> bool:
    if mesh.material.kind == "glass":
        return mesh.material.alpha < 0.5
    return mesh.name.startswith(("occluder/lattice", "mask/veil"))


@lru_cache(maxsize=8)
def _view(yaw_deg: float) -> tuple[Float64[ndarray, "3 3"], Bool[ndarray, "h w"]]:
    """Returns the axes to the right, up and towards the camera, and the pixels of the face."""
    yaw = np.deg2rad(yaw_deg)
    axes = np.array([[np.cos(yaw), 0, -np.sin(yaw)], [0, 1, 0], [np.sin(yaw), 0, np.cos(yaw)]])
    model = builtin_model()
    corners = model.mean[model.triangles[model.is_face_triangle]]
    ahead = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ axes[2]
    return axes, _drawn(model.mean, model.triangles[model.is_face_triangle][ahead > 0], axes, -1e3)


def _drawn(
    vertices: Float32[ndarray, "v 3"],
    triangles: Int[ndarray, "t 3"],
    axes: Float64[ndarray, "3 3"],
    nearer_than_mm: float,
) -> Bool[ndarray, "h w"]:
    """Returns the pixels that triangles cover, seen along the third axis."""
    seen = vertices @ axes.T
    depth = seen[:, 2]
    a, b, c = triangles.T
    triangles = triangles[depth[a] + depth[b] + depth[c] > 3 * nearer_than_mm]
    corners = ((seen[:, :2] * [1, -1] / _SPAN_MM + [0.5, 0.55]) * _PIXELS)[triangles]
    middles = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3
    places = np.concatenate([corners, middles[:, None]], axis=1).round().astype(np.int32)
    picture: UInt8[ndarray, "h w"] = np.zeros((_PIXELS, _PIXELS), dtype=np.uint8)
    a, b, c = places[:, 0], places[:, 1], places[:, 2]
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    is_large = ((high - low > 2) & (high >= 0) & (low < _PIXELS)).any(axis=1)
    for triangle in places[is_large, :3]:
        cv2.fillConvexPoly(picture, triangle, 1)
    # For speed, small triangles are drawn as their corners and centroids.
    dots = places[~is_large].reshape(-1, 2)
    dots = dots[((dots >= 0) & (dots < _PIXELS)).all(axis=1)]
    picture[dots[:, 1], dots[:, 0]] = 1
    return picture.astype(bool)
