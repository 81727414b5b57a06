"""Meshes that are awkward for a rasteriser, and models of nothing but a mesh."""

import numpy as np
import trimesh
from numpy import ndarray

from pix2face.geometry.camera import Camera
from pix2face.models.morphable_model import MorphableModel


def mesh_model(vertices: ndarray, triangles: ndarray, mean: ndarray | None = None) -> MorphableModel:
    """A model without components, all of it face; ``vertices`` are its mean unless another is given."""
    mean = np.asarray(vertices if mean is None else mean, dtype=np.float32)
    none = np.zeros((0, len(mean), 3), dtype=np.float32)
    return MorphableModel(
        name="a mesh",
        licence="CC0-1.0",
        origin="tests/meshes.py",
        sha256="0" * 64,
        mean=mean,
        identity_basis=none,
        expression_basis=none,
        triangles=np.ascontiguousarray(triangles, dtype=np.int32),
        triangle_regions=np.zeros(len(triangles), dtype=np.uint8),
        region_names=("skin",),
        face_regions=("skin",),
        landmarks={},
        uv=None,
        uv_triangles=None,
        symmetry=None,
        named_expressions={},
    )


def sheet(columns: int, rows: int) -> tuple[ndarray, ndarray]:
    """A unit square in x and y, cut into triangles that turn their outside to +z."""
    y, x = np.mgrid[0 : 1 : (rows + 1) * 1j, 0 : 1 : (columns + 1) * 1j]
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), triangles.astype(np.int32)


def touching_lips(gap_mm: float) -> tuple[MorphableModel, ndarray]:
    """Two curved sheets, 30 mm apart in the mean and pressed together in this face.

    Their distance is a wave about 0 of at most ``gap_mm``, so each is in front of the other in half of the picture.
    A triangle far behind them stretches the range of depths.

    Returns:
        The model, and the vertices of this face, mm.
    """
    upper, upper_triangles = sheet(31, 27)
    lower, lower_triangles = sheet(23, 29)
    flat = np.concatenate([upper, lower])[:, :2] * 100 - 50
    bend = 10 * np.cos(flat[:, 0] / 30) + 5 * np.sin(flat[:, 1] / 17)
    is_lower = np.arange(len(flat)) >= len(upper)
    wave = gap_mm * np.sin(flat[:, 0] / 9) * np.cos(flat[:, 1] / 11)
    face = np.column_stack([flat, bend + np.where(is_lower, wave, 0)])
    mean = np.column_stack([flat, bend - 30.0 * is_lower])
    far = np.array([[-20.0, -20, -20_000], [20, -20, -20_000], [0, 20, -20_000]])
    triangles = np.concatenate([upper_triangles, lower_triangles + len(upper), [[0, 1, 2] + np.full(3, len(flat))]])
    return mesh_model(face, triangles, np.concatenate([mean, far])), np.concatenate([face, far]).astype(np.float32)


def ray_casting(camera: Camera, vertices: ndarray, triangles: ndarray, size_px: int) -> tuple[ndarray, ndarray]:
    """What rays through the pixel centres hit first, in float64 and without any of our code.

    Returns:
        Number of the triangle (-1: none) and the point (mm) for each pixel.
    """
    row, column = np.indices((size_px, size_px)).reshape(2, -1)
    centres = np.column_stack([column, row]) + 0.5
    # A pixel's ray is where two planes meet: (row 0 - u row 3) (x, 1) = 0 and (row 1 - v row 3) (x, 1) = 0.
    planes = camera.matrix[:2][None] - centres[:, :, None] * camera.matrix[3]
    direction = np.cross(planes[:, 0, :3], planes[:, 1, :3])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    direction *= np.sign(direction @ camera.matrix[2, :3])[:, None]
    third = np.concatenate([planes[:, :, :3], direction[:, None]], axis=1)
    nearest_to_origin = np.linalg.solve(third, np.column_stack([-planes[:, :, 3], np.zeros(len(centres))])[..., None])
    mesh = trimesh.Trimesh(vertices.astype(np.float64), triangles, process=False)
    start = nearest_to_origin[..., 0] - 1000 * direction
    points, ray, triangle = mesh.ray.intersects_location(start, direction, multiple_hits=True)
    depth = camera.depth(points)
    order = np.lexsort((depth, ray))
    order = order[camera.is_affine | (depth[order] > 0)]
    first = order[np.unique(ray[order], return_index=True)[1]]
    hit, where = np.full(size_px**2, -1), np.zeros((size_px**2, 3))
    hit[ray[first]], where[ray[first]] = triangle[first], points[first]
    return hit.reshape(size_px, size_px), where.reshape(size_px, size_px, 3)
