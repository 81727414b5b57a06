"""Where pixels are on the mean face, exactly: the triangle that their PNCC lies in, and the place inside it.

Between a vertex and the pixels around it the maps have a kink, since they are linear in each triangle only; that leaves
0.01 mm at a vertex, and hidden parts of the face, which hang on coefficients that hardly move what is seen, are off by
ten times that. A pixel inside a triangle has no kink: its offset is the interpolated offset of three vertices, up to
the rounding of the maps. Worth its time on exact maps only.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np
from jaxtyping import Float64, Int
from numpy import ndarray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from pix2face.fitting.localise import ValidPixels
from pix2face.fitting.prepared_model import evenly_spread, vertex_basis
from pix2face.models.morphable_model import MorphableModel

# Rounding to 1/128 mm leaves a PNCC this far off its triangle at most.
ON_SURFACE_MM = 0.01
INSIDE = 0.01


@final
@dataclass(frozen=True, eq=False)
class _Surface:
    """The vertices of a face, and the triangles around each."""

    vertices: Int[ndarray, " n"]
    tree: cKDTree  # of their places in the mean face
    triangles: Int[ndarray, "n d"]  # around each vertex, -1 where there are fewer


def surface_rows(
    model: MorphableModel, pixels: ValidPixels, at_most: int
) -> tuple[Float64[ndarray, "n 3 c"], Float64[ndarray, "n 3"]]:
    """Basis (mm per standard deviation, identity first) and offset (mm) at pixels that lie inside a triangle.

    A pixel does if its PNCC lies inside a triangle of the mean face. At most ``at_most`` are looked at, evenly spread.
    """
    chosen = evenly_spread(len(pixels.places), at_most)
    points = pixels.pncc[chosen].astype(np.float64)
    triangle, barycentric = _place_on_surface(model, points)
    found = np.flatnonzero(triangle >= 0)
    corners = model.triangles[triangle[found]]
    used, column = np.unique(corners, return_inverse=True)
    mixing = csr_array(
        (barycentric[found].reshape(-1), column.reshape(-1), np.arange(0, 3 * len(found) + 1, 3)),
        shape=(len(found), len(used)),
    )
    basis = vertex_basis(model, used).astype(np.float64)
    rows = (mixing @ basis.reshape(len(used), 3 * basis.shape[2])).reshape(len(found), *basis.shape[1:])
    return rows, pixels.offset[chosen][found].astype(np.float64)


def _place_on_surface(
    model: MorphableModel, points: Float64[ndarray, "n 3"]
) -> tuple[Int[ndarray, " n"], Float64[ndarray, "n 3"]]:
    """The triangle around the nearest vertex that each point lies in (-1: none), and its barycentric coordinates."""
    surface = _surface(model)
    candidates = surface.triangles[surface.tree.query(points)[1]]
    corners = model.mean.astype(np.float64)[model.triangles[candidates]]  # n, candidate, corner, xyz
    a, b = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
    p = points[:, None] - corners[:, :, 0]
    normal = np.cross(a, b)
    area = np.maximum((normal**2).sum(axis=2), 1e-30)
    second = (np.cross(p, b) * normal).sum(axis=2) / area
    third = (np.cross(a, p) * normal).sum(axis=2) / area
    barycentric = np.stack([1 - second - third, second, third], axis=2)
    off_plane = np.abs((p * normal).sum(axis=2)) / np.sqrt(area)
    outside = np.maximum(-barycentric.min(axis=2), 0)
    fits = (candidates >= 0) & (off_plane < ON_SURFACE_MM) & (outside < INSIDE)
    best = np.argmin(np.where(fits, outside, np.inf), axis=1)
    row = np.arange(len(points))
    return np.where(fits[row, best], candidates[row, best], -1), barycentric[row, best]


@lru_cache(maxsize=2)
def _surface(model: MorphableModel) -> _Surface:
    face_triangles = np.flatnonzero(model.is_face_triangle)
    corners = model.triangles[face_triangles].reshape(-1)
    order = np.argsort(corners, kind="stable")
    vertices, first, count = np.unique(corners[order], return_index=True, return_counts=True)
    table = np.full((len(vertices), int(count.max())), -1, dtype=np.intp)
    within = np.arange(len(order)) - np.repeat(first, count)
    table[np.repeat(np.arange(len(vertices)), count), within] = face_triangles[order // 3]
    return _Surface(vertices, cKDTree(model.mean[vertices]), table)
