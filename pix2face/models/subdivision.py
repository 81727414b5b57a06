"""Catmull-Clark subdivision as a fixed sparse operator: a small file becomes a dense, smooth mesh.

Vertices of the refined mesh are the old vertices (moved) with their old indices, then one for each edge, then one for
each polygon. Vertex indices, such as landmarks, therefore survive any number of steps.

Source: Catmull and Clark 1978; boundary as in DeRose, Kass and Truong 1998 (a boundary is a crease).
"""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray
from scipy.sparse import csr_array, diags_array, vstack

from pix2face.models.model_file import StoredModel


@final
@dataclass(frozen=True, eq=False)
class Refinement:
    """One step of subdivision, from an old mesh to a refined one."""

    operator: csr_array  # (refined vertices x vertices), rows sum to 1
    # Polygons of the refined mesh, four (of a triangle three) for each old one, in the old order.
    quads: Int32[ndarray, "q 4"]
    parents: Int32[ndarray, " q"]  # the old polygon of each quad
    edges: Int32[ndarray, "m 2"]  # the old mesh's edges (lower index first), in the order of their new vertices
    n_vertices: int  # of the old mesh


def refine(stored: StoredModel) -> StoredModel:
    """Refines everything that a model carries by one step. Source vertices are dropped: new vertices have none."""
    step = catmull_clark(stored.polygons, len(stored.mean))
    uv, uv_polygons = stored.uv, stored.uv_polygons
    if uv is not None and uv_polygons is not None:
        uv, uv_polygons = _refine_texture(uv, uv_polygons)
    return replace(
        stored,
        mean=_apply(step.operator, stored.mean[None])[0],
        identity_basis=_apply(step.operator, stored.identity_basis),
        expression_basis=_apply(step.operator, stored.expression_basis),
        polygons=step.quads,
        polygon_regions=stored.polygon_regions[step.parents],
        uv=uv,
        uv_polygons=uv_polygons,
        symmetry=None if stored.symmetry is None else refined_symmetry(step, stored.polygons, stored.symmetry),
        source_vertices=None,
        albedo_mean=None if stored.albedo_mean is None else _apply(step.operator, stored.albedo_mean[None])[0],
        albedo_basis=None if stored.albedo_basis is None else _apply(step.operator, stored.albedo_basis),
    )


def catmull_clark(polygons: Int32[ndarray, "p 4"], n_vertices: int) -> Refinement:
    """One step for quads (a triangle has -1 in the last place); a vertex that no polygon uses stays where it is."""
    edges, quads, edge_of_corner = _topology(polygons, n_vertices)
    face_points = _face_points(polygons, n_vertices)
    is_boundary = np.bincount(edge_of_corner[edge_of_corner >= 0], minlength=len(edges)) != 2
    edge_points = _edge_points(edges, edge_of_corner, is_boundary, face_points, n_vertices)
    vertex_points = _vertex_points(polygons, edges, is_boundary, face_points, n_vertices)
    operator = csr_array(vstack([vertex_points, edge_points, face_points]))
    parents = np.nonzero(polygons >= 0)[0].astype(np.int32)
    return Refinement(operator, quads, parents, edges, n_vertices)


def refined_symmetry(
    step: Refinement, polygons: Int32[ndarray, "p 4"], symmetry: Int32[ndarray, " v"]
) -> Int32[ndarray, " r"]:
    """The mirror map of a refined mesh from that of the mesh."""
    edges = _partners(step.edges, np.sort(symmetry[step.edges], axis=1))
    mirrored = np.where(polygons >= 0, symmetry[polygons], -1)
    faces = _partners(np.sort(polygons, axis=1), np.sort(mirrored, axis=1))
    first_face = step.n_vertices + len(step.edges)
    return np.concatenate([symmetry, step.n_vertices + edges, first_face + faces]).astype(np.int32)


def _partners(rows: ndarray, mirrored: ndarray) -> ndarray:
    """For each row the index of the row that equals its mirror image."""
    order, mirrored_order = np.lexsort(rows.T), np.lexsort(mirrored.T)
    if not np.array_equal(rows[order], mirrored[mirrored_order]):
        raise ValueError("expected a mesh that is its own mirror image")
    partners = np.empty(len(rows), dtype=np.int32)
    partners[mirrored_order] = order
    return partners


def _topology(polygons: ndarray, n_vertices: int) -> tuple[ndarray, ndarray, ndarray]:
    """Edges, child quads, and for each corner of each polygon the edge that leaves it (-1: no corner)."""
    is_corner = polygons >= 0
    following = np.roll(polygons, -1, axis=1)
    is_triangle = ~is_corner[:, 3]
    following[is_triangle, 2] = polygons[is_triangle, 0]
    ends = np.sort(np.stack([polygons, following], axis=-1)[is_corner], axis=1).astype(np.int64)
    # One number for each edge, because NumPy sorts pairs ten times as slowly.
    numbers, edge = np.unique(ends[:, 0] * n_vertices + ends[:, 1], return_inverse=True)
    edges = np.column_stack(np.divmod(numbers, n_vertices))
    edge_of_corner = np.full(polygons.shape, -1)
    edge_of_corner[is_corner] = edge
    previous = np.roll(edge_of_corner, 1, axis=1)
    previous[is_triangle, 0] = edge_of_corner[is_triangle, 2]
    face = n_vertices + len(edges) + np.broadcast_to(np.arange(len(polygons))[:, None], polygons.shape)
    # Each corner becomes a quad: the corner, its leaving edge, the face, its arriving edge. The winding stays.
    quads = np.stack([polygons, n_vertices + edge_of_corner, face, n_vertices + previous], axis=-1)[is_corner]
    return edges.astype(np.int32), quads.astype(np.int32), edge_of_corner


def _face_points(polygons: ndarray, n_vertices: int) -> csr_array:
    is_corner = polygons >= 0
    face = np.nonzero(is_corner)[0]
    weights = 1 / is_corner.sum(axis=1)[face]
    return csr_array((weights, (face, polygons[is_corner])), shape=(len(polygons), n_vertices))


def _edge_points(
    edges: ndarray, edge_of_corner: ndarray, is_boundary: ndarray, face_points: csr_array, n_vertices: int
) -> csr_array:
    """Boundary: the midpoint. Inside: the mean of both ends and both face points."""
    index = np.repeat(np.arange(len(edges)), 2)
    to_end = np.where(is_boundary, 0.5, 0.25)[index]
    ends = csr_array((to_end, (index, edges.ravel())), shape=(len(edges), n_vertices))
    face, corner = np.nonzero(edge_of_corner >= 0)
    edge = edge_of_corner[face, corner]
    to_face = np.where(is_boundary, 0, 0.25)[edge]
    faces = csr_array((to_face, (edge, face)), shape=(len(edges), face_points.shape[0]))
    return csr_array(ends + faces @ face_points)


def _vertex_points(
    polygons: ndarray, edges: ndarray, is_boundary: ndarray, face_points: csr_array, n_vertices: int
) -> csr_array:
    """Inside: (F + 2 R + (n - 3) P) / n. Boundary: 3/4 P + 1/8 of both neighbours on it. Unused: P."""
    is_corner = polygons >= 0
    valence = np.bincount(edges.ravel(), minlength=n_vertices).astype(np.float64)
    on_boundary = np.zeros(n_vertices, dtype=bool)
    on_boundary[edges[is_boundary]] = True
    inside = (valence > 0) & ~on_boundary
    n = np.where(inside, valence, 1)
    ends = np.concatenate([edges, edges[:, ::-1]])
    along_boundary = np.concatenate([is_boundary, is_boundary])
    # R averages edge midpoints: half of it is P, so 2 R / n leaves P / n and 1 / n^2 for each neighbour.
    to_neighbour = np.where(inside[ends[:, 0]], 1 / n[ends[:, 0]] ** 2, np.where(along_boundary, 1 / 8, 0))
    neighbours = csr_array((to_neighbour, (ends[:, 0], ends[:, 1])), shape=(n_vertices, n_vertices))
    stay = np.where(inside, (n - 2) / n, np.where(on_boundary, 1 - np.asarray(neighbours.sum(axis=1)), 1))
    own = diags_array(stay, format="csr")
    vertex, face = polygons[is_corner], np.nonzero(is_corner)[0]
    to_face = np.where(inside, 1 / n**2, 0)[vertex]
    faces = csr_array((to_face, (vertex, face)), shape=(n_vertices, len(polygons)))
    return csr_array(own + neighbours + faces @ face_points)


def _refine_texture(
    uv: Float32[ndarray, "u 2"], uv_polygons: Int32[ndarray, "p 4"]
) -> tuple[Float32[ndarray, "r 2"], Int32[ndarray, "q 4"]]:
    """Texture coordinates at edge midpoints and face centres: linear, so that charts keep their borders."""
    edges, quads, _ = _topology(uv_polygons, len(uv))
    centres = _face_points(uv_polygons, len(uv)) @ uv.astype(np.float64)
    return np.concatenate([uv, uv[edges].mean(axis=1), centres]).astype(np.float32), quads


def _apply(operator: csr_array, values: Float32[ndarray, "k v 3"]) -> Float32[ndarray, "k r 3"]:
    k, v, _ = values.shape
    refined = operator @ values.transpose(1, 0, 2).reshape(v, 3 * k)
    return np.ascontiguousarray(refined.reshape(-1, k, 3).transpose(1, 0, 2), dtype=np.float32)
