"""Normals at the vertices of a mesh."""

import numpy as np
from jaxtyping import Float, Float64, Int
from numpy import ndarray


def vertex_normals(vertices: Float[ndarray, "v 3"], triangles: Int[ndarray, "t 3"]) -> Float64[ndarray, "v 3"]:
    """Unit normals, the mean of the triangles' at each vertex weighted by area; 0 where no triangle is."""
    corners = vertices[triangles].astype(np.float64)
    normals = np.repeat(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), 3, axis=0)
    columns = [np.bincount(triangles.ravel(), normals[:, axis], minlength=len(vertices)) for axis in range(3)]
    total = np.stack(columns, axis=1)
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(total / np.where(lengths > 0, lengths, 1), dtype=np.float64)
