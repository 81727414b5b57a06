"""What painting and lighting need to know of a model's mesh, worked out once."""

from typing import final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray
from scipy import sparse

from pix2face.morphable_model import MorphableModel


@final
class Surface:
    """Neighbourhoods of a model's vertices.

    Attributes:
        mean: The mean face, mm: where on a face a vertex is.
        region_names: The model's.
        region_weights: For each vertex, how much of its surroundings belongs to each region; rows sum to 1. Colours
            mixed by them fade over one triangle where regions meet.
    """

    def __init__(self, model: MorphableModel) -> None:
        n_vertices, n_triangles = len(model.mean), len(model.triangles)
        corner, triangle = model.triangles.reshape(-1), np.repeat(np.arange(n_triangles), 3)
        ones = np.ones(len(corner), dtype=np.float32)
        self._triangles = model.triangles
        self._incidence = sparse.csr_array((ones, (corner, triangle)), shape=(n_vertices, n_triangles))
        in_region = np.eye(len(model.region_names), dtype=np.float32)[model.triangle_regions]
        weights = self._incidence @ in_region
        self.region_names = model.region_names
        self.region_weights: Float32[ndarray, "v r"] = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1)
        self.mean = model.mean

    def normals(self, vertices: Float32[ndarray, "v 3"]) -> Float32[ndarray, "v 3"]:
        """Unit normals, outward: the mean of the triangles around, by area. 0 at a vertex without triangles."""
        a, b, c = (vertices[self._triangles[:, k]] for k in range(3))
        normals = self._incidence @ np.cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(normals / np.where(length > 0, length, 1), dtype=np.float32)
