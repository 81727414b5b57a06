"""Finds where the inside of a head may be seen: only openings of the mesh show the backs of its triangles.

Half of all triangles turn their back to the camera, and drawing them takes half of the time.
"""

from typing import final

import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from datagen.rendering.processor.nearest import NOWHERE, Box
from pix2face.geometry.camera import Camera
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import shows_outside

# Parts that other parts hide on all sides: their openings do not count.
WITHIN = ("mouth_inside", "teeth", "tongue")


@final
class Openings:
    """The openings of a model's mesh."""

    def __init__(self, model: MorphableModel) -> None:
        edges = _open_edges(model)
        n_vertices = len(model.mean)
        graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n_vertices, n_vertices))
        loop_of_vertex = connected_components(graph, directed=False)[1]
        self._loops = [edges[loop_of_vertex[edges[:, 0]] == loop] for loop in np.unique(loop_of_vertex[edges[:, 0]])]

    def box(self, vertices: Float32[ndarray, "v 3"], camera: Camera, height: int, width: int) -> Box:
        """The box in which the inside of the head may be seen; `NOWHERE` if it is not."""
        fans = np.concatenate([_fan(vertices[loop]) for loop in self._loops] or [np.zeros((0, 3, 3))])
        points = fans.reshape(-1, 3)
        if (points @ camera.matrix[3, :3] + camera.matrix[3, 3] <= 0).any():
            return 0, 0, width, height
        facing = shows_outside(camera, points, np.arange(len(points)).reshape(-1, 3))
        if not facing.any():
            return NOWHERE
        image = np.clip(camera.project(fans[facing].reshape(-1, 3)), 0, [width, height])
        (left, top), (right, bottom) = np.floor(image.min(axis=0)), np.ceil(image.max(axis=0))
        return (int(left), int(top), int(right), int(bottom)) if left < right and top < bottom else NOWHERE


def _open_edges(model: MorphableModel) -> Int64[ndarray, "e 2"]:
    """Edges that belong to a single triangle, in its direction."""
    outer = ~model.triangles_of(*WITHIN)
    triangles = model.triangles.astype(np.int64)
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    key = np.sort(edges, axis=1) @ [len(model.mean), 1]
    _, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
    return edges[(count[inverse] == 1) & np.repeat(outer, 3)]


def _fan(edges: Float32[ndarray, "e 2 3"]) -> Float32[ndarray, "e 3 3"]:
    """Triangles from the edges of an opening to its middle: a ray gets in where one of them shows its outside."""
    middle = np.broadcast_to(edges.reshape(-1, 3).mean(axis=0), (len(edges), 1, 3))
    return np.concatenate([edges[:, ::-1], middle], axis=1)
