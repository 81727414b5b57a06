"""Which vertices of a posed mesh nothing hides: exact, and quick for a few of them.

For many vertices, or a whole picture, compare with a rendered depth (``rasterise``) instead.
"""

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from numpy import ndarray

from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import Camera
from pix2face.geometry.crops import Crop
from pix2face.geometry.landmarks import IBUG68, LANDMARK_TOLERANCE_MM
from pix2face.geometry.maps import FaceMaps, uncovered_points


def visible_landmarks(fit: FaceFit) -> Bool[ndarray, "68"]:
    """Which of the 68 landmarks of a fitted face the head itself does not hide."""
    return visible_vertices(fit.vertices, fit.model.triangles, fit.camera, fit.model.landmarks[IBUG68])


def landmarks_in_sight(fit: FaceFit, maps: FaceMaps, crop: Crop) -> Bool[ndarray, " m"]:
    """Which landmarks neither the head hides nor, as far as the network says it, something in front of the head.

    The fit is in pixels of the photograph, and ``crop`` is what the maps were predicted for.
    """
    visible = visible_landmarks(fit)
    if maps.seen is None:
        return visible
    return visible & uncovered_points(crop.to_crop(fit.landmarks2d), maps.mask, maps.seen)


def visible_vertices(
    vertices: Float[ndarray, "v 3"],
    triangles: Int[ndarray, "t 3"],
    camera: Camera,
    indices: Int[ndarray, " m"],
    *,
    tolerance_mm: float = LANDMARK_TOLERANCE_MM,
) -> Bool[ndarray, " m"]:
    """Whether the line of sight to each vertex meets no other part of the mesh in front of it.

    Borders of the picture do not count: a vertex beside the picture may be visible. The triangles are those of the
    whole mesh (mm, model frame), since scalp, neck and backs hide as well; one hides only if it is nearer by more than
    the tolerance.
    """
    pixels, depths = camera.project(vertices), camera.depth(vertices)
    points, limits = pixels[indices], depths[indices] - tolerance_mm
    # One row for each corner of the triangles: NumPy gathers and reduces long rows fastest.
    corners = np.ascontiguousarray(triangles.T)
    corners = corners.compress(depths[corners].min(axis=0) < limits.max(initial=-np.inf), axis=1)
    triangle, place = _pairs_in_columns(pixels[:, 0][corners], points[:, 0])
    corners = corners.take(triangle, axis=1)
    y, rows = points[place, 1], pixels[:, 1][corners]
    near = (depths[corners].min(axis=0) < limits[place]) & (rows.min(axis=0) <= y) & (rows.max(axis=0) >= y)
    corners, place = corners[:, near].T, place[near]
    hides = _depths_at(points[place], pixels[corners], depths[corners]) < limits[place]
    visible = np.ones(len(indices), dtype=bool)
    visible[place[hides]] = False
    return visible


def _pairs_in_columns(
    corners_x: Float64[ndarray, "3 t"], points_x: Float64[ndarray, " m"]
) -> tuple[Int[ndarray, " n"], Int[ndarray, " n"]]:
    """Every pair of a triangle and a point between its left and its right end: which triangle, and which point."""
    order = np.argsort(points_x)
    first = np.searchsorted(points_x[order], corners_x.min(axis=0), side="left")
    count = np.searchsorted(points_x[order], corners_x.max(axis=0), side="right") - first
    triangle = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
    return triangle, order[first[triangle] + within]


def _depths_at(
    points: Float64[ndarray, "n 2"], corners: Float64[ndarray, "n 3 2"], depths: Float64[ndarray, "n 3"]
) -> Float64[ndarray, " n"]:
    """The depth of each triangle where the line of sight to its point meets it; inf where it does not.

    Depth is blended linearly over the picture: under a pinhole it is off by less than the tolerance for triangles of
    some mm.
    """
    relative = corners - points[:, None]
    following = np.roll(relative, -1, axis=1)
    # Twice the signed areas of the triangles that the point makes with each side; opposite corner first.
    areas = np.roll(relative[..., 0] * following[..., 1] - relative[..., 1] * following[..., 0], -1, axis=1)
    total = areas.sum(axis=1)
    inside = (areas >= 0).all(axis=1) | (areas <= 0).all(axis=1)
    meets = inside & (total != 0)
    blended = (areas * depths).sum(axis=1) / np.where(meets, total, 1)
    return np.where(meets, blended, np.inf)
