"""What every fit needs of a morphable model, gathered once: some vertices of the face, their basis, a way to find them.

The gathering takes tenths of a second; a fit then touches a few megabytes instead of the whole basis.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np
from jaxtyping import Float, Float32, Int, Int32
from numpy import ndarray

from pix2face.models.morphable_model import MorphableModel

# Edge of a cell of the grid: well below the distance of the vertices that are looked for.
CELL_MM = 2.0
# A cell farther from all vertices than this (some cells more than their distance) has none.
REACH_MM = 7.0

# Errors of a network are alike over patches of the face; of the whole face, a picture shows about half the patches.
N_PATCHES = 60


@final
@dataclass(frozen=True, eq=False)
class VertexGrid:
    """The nearest vertex of each cell of a grid over the mean face: pixels look their vertex up."""

    origin_mm: Float32[ndarray, "3"]  # corner of the grid
    # For each cell the nearest vertex (its number in the list of vertices); -1 where there is none, as at the border.
    table: Int32[ndarray, "x y z"]

    @classmethod
    def of(cls, points: Float32[ndarray, "n 3"]) -> "VertexGrid":
        """Makes the grid of some vertices (mm, model frame)."""
        origin = points.min(axis=0) - np.float32(REACH_MM)
        shape = np.ceil((points.max(axis=0) + REACH_MM - origin) / CELL_MM).astype(int)
        centres = [start + CELL_MM * (np.arange(n) + 0.5) for start, n in zip(origin, shape, strict=True)]
        nearest, least = np.full(shape, -1, dtype=np.int32), np.full(shape, REACH_MM**2)
        # A point reaches few cells: looking at them is ten times as fast as asking a tree for each cell of the grid.
        reach = math.ceil(REACH_MM / CELL_MM)
        first = np.maximum(((points - origin) / CELL_MM).astype(int) - reach, 0)
        for index, (point, start) in enumerate(zip(points.astype(np.float64), first, strict=True)):
            cells = tuple(slice(begin, begin + 2 * reach + 1) for begin in start)
            x, y, z = ((own[part] - at) ** 2 for own, part, at in zip(centres, cells, point, strict=True))
            squared = x[:, None, None] + y[:, None] + z
            is_nearer = squared < least[cells]
            least[cells][is_nearer], nearest[cells][is_nearer] = squared[is_nearer], index
        return cls(origin - np.float32(CELL_MM), np.pad(nearest, 1, constant_values=-1))

    def look_up(self, points: Float32[ndarray, "n 3"]) -> Int32[ndarray, " n"]:
        """The vertex of the cell that each point (mm, finite) is in; -1 where there is none."""
        flat = np.zeros(len(points), dtype=np.int32)
        # Axis by axis, because NumPy is slow with short rows.
        for values, origin, count in zip(points.T, self.origin_mm, self.table.shape, strict=True):
            cell = np.clip((values - origin) * np.float32(1 / CELL_MM), 0, count - 1)
            flat = flat * np.int32(count) + cell.astype(np.int32)
        return self.table.reshape(-1).take(flat)


@final
@dataclass(frozen=True, eq=False)
class PreparedModel:
    """Some vertices of a model's face."""

    mean: Float32[ndarray, "n 3"]  # mm
    # Identity, then expression, mm per standard deviation; a vertex is one run of memory.
    basis: Float32[ndarray, "n 3 c"]
    grid: VertexGrid  # finds the vertex for a PNCC value
    patches: Int[ndarray, " n"]  # for each vertex the number of the patch of the face that it lies in


@lru_cache(maxsize=4)
def prepared_model(model: MorphableModel, at_most: int) -> PreparedModel:
    """Gathers at most ``at_most`` vertices, evenly spread over the face; remembers the last four answers."""
    vertex_indices = spread_vertices(model, at_most)
    mean = model.mean[vertex_indices]
    return PreparedModel(mean, vertex_basis(model, vertex_indices), VertexGrid.of(mean), patches_of(mean, N_PATCHES))


def vertex_basis(model: MorphableModel, vertex_indices: Int[ndarray, " n"]) -> Float32[ndarray, "n 3 c"]:
    """Both bases at some vertices, mm per standard deviation, identity before expression, components last."""
    both = [np.take(basis, vertex_indices, axis=1) for basis in (model.identity_basis, model.expression_basis)]
    return np.ascontiguousarray(np.concatenate(both).transpose(1, 2, 0))


def spread_vertices(model: MorphableModel, at_most: int) -> Int[ndarray, " n"]:
    """At most ``at_most`` vertices of the face, evenly spread over its list of vertices."""
    face = np.flatnonzero(model.is_face_vertex)
    return face[evenly_spread(len(face), at_most)]


def evenly_spread(total: int, at_most: int) -> Int[ndarray, " n"]:
    """At most ``at_most`` indices below a total, at even distances."""
    return np.linspace(0, max(total - 1, 0), min(total, at_most)).astype(np.intp)


def patches_of(points: Float[ndarray, "n 3"], count: int) -> Int[ndarray, " n"]:
    """Divides points into patches around centres that are as far from each other as they can be (farthest first)."""
    if len(points) == 0:
        return np.zeros(0, dtype=np.intp)
    patch, distance = np.zeros(len(points), dtype=np.intp), np.full(len(points), np.inf)
    centre = int(np.argmin(points[:, 0]))
    for index in range(min(count, len(points))):
        to_centre = ((points - points[centre]) ** 2).sum(axis=1)
        patch[to_centre < distance] = index
        distance = np.minimum(distance, to_centre)
        centre = int(np.argmax(distance))
    return patch
