"""Meshes that are bound to the head: each point follows a weighted mean of vertices of the head.

`scripts.build_hair_assets` makes them for the built-in model.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import final

import numpy as np
from jaxtyping import Float, Float32, Int32
from numpy import ndarray
from scipy import sparse

from datagen.appearance.asset_files import open_asset
from pix2face.errors import InputFileError
from pix2face.models.morphable_model import MorphableModel

_MESHES = "hair/meshes.h5"
MIRRORED = np.array([-1, 1, 1], dtype=np.float32)


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class BoundMesh:
    """A mesh on the mean head of a model that can follow other heads of the model."""

    name: str  # of the style
    # points on the mean head, mm, model frame; several vertices share one along seams of the texture
    mean: Float32[ndarray, "p 3"]
    feet: Float32[ndarray, "p 3"]  # nearest place on the skin of each point, on the mean head
    neighbours: Int32[ndarray, "p n"]  # vertices of the model that each point follows
    weights: Float32[ndarray, "p n"]  # of the neighbours; rows sum to 1
    normals: Float32[ndarray, "p 3"]  # unit normals of the points, on the mean head
    point_of_vertex: Int32[ndarray, " v"]  # index of the point of each vertex
    uv: Float32[ndarray, "v 2"]  # texture coordinates of each vertex, with the origin at the top left
    triangles: Int32[ndarray, "t 3"]

    def displacements(self, head: Float[ndarray, "h 3"], mean: Float[ndarray, "h 3"]) -> Float32[ndarray, "p 3"]:
        """Returns the displacement of each point on a head; `head` and `mean` are vertices in mm, model frame."""
        moved = (head - mean).astype(np.float32)
        followed = self._followed
        return np.asarray(followed @ moved[: followed.shape[1]], dtype=np.float32)

    @cached_property
    def _followed(self) -> sparse.csr_array:
        """The weights as a sparse matrix, which takes a quarter of the time of indexing with the neighbours."""
        n_points, n_each = self.neighbours.shape
        starts = np.arange(0, n_points * n_each + 1, n_each)
        shape = n_points, int(self.neighbours.max()) + 1
        return sparse.csr_array((self.weights.reshape(-1), self.neighbours.reshape(-1), starts), shape=shape)


def mirrored(mesh: BoundMesh, symmetry: Int32[ndarray, " v"]) -> BoundMesh:
    """Returns the mirror image of a mesh, bound to the mirrored vertices."""
    return replace(
        mesh,
        mean=mesh.mean * MIRRORED,
        feet=mesh.feet * MIRRORED,
        normals=mesh.normals * MIRRORED,
        neighbours=symmetry[mesh.neighbours].astype(np.int32),
        triangles=np.ascontiguousarray(mesh.triangles[:, [0, 2, 1]]),
    )


@cache
def bound_mesh(name: str, *, is_mirrored: bool = False) -> BoundMesh:
    """Reads a mesh of the built-in assets, such as `short01`, or makes its mirror image."""
    if is_mirrored:
        return mirrored(bound_mesh(name), _symmetry())
    with open_asset(_MESHES) as file:
        group, step = file[name], np.float32(file.attrs["position_step_mm"])
        weights = group["weights"][()].astype(np.float32)
        return BoundMesh(
            name=name,
            mean=group["mean"][()] * step,
            feet=group["feet"][()] * step,
            neighbours=group["neighbours"][()].astype(np.int32),
            weights=weights / weights.sum(axis=1, keepdims=True),
            normals=group["normals"][()].astype(np.float32) / 127,
            point_of_vertex=group["point_of_vertex"][()].astype(np.int32),
            uv=group["uv"][()],
            triangles=group["triangles"][()].astype(np.int32),
        )


def brow_patch() -> Mapping[str, ndarray]:
    """Reads the `vertices` of the built-in model below the left brow, their `triangles` and `uv`."""
    with open_asset(_MESHES) as file:
        return {name: file["brows"][name][()] for name in ("vertices", "triangles", "uv")}


def check_model(model: MorphableModel) -> None:
    """Raises an `InputFileError` unless the model is the built-in one at its default refinement."""
    bound_to, n_vertices = _bound_to()
    if model.sha256 != bound_to or len(model.mean) != n_vertices:
        raise InputFileError(
            f"hair is bound to the built-in model with {n_vertices} vertices, found {model.name!r} with "
            f"{len(model.mean)}; draw it with the appearance `plain`, or render with `--model builtin`"
        )


@cache
def _bound_to() -> tuple[str, int]:
    with open_asset(_MESHES) as file:
        return str(file.attrs["model_sha256"]), int(file.attrs["n_vertices"])


@cache
def _symmetry() -> Int32[ndarray, " v"]:
    with open_asset(_MESHES) as file:
        return file["symmetry"][()].astype(np.int32)
