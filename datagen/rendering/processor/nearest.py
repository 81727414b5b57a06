"""Finds what is nearest in pictures of scenes: a z-buffer for the samples of a picture and for shadow maps.

A triangle is cut into rows, and a row into the samples between its edges, so that a sample costs one comparison. The
fixed pipeline of a software driver takes three to five times as long for the small triangles of a face.
"""

import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled

Box = tuple[int, int, int, int]  # left, top, right, bottom; the last two are excluded
NOWHERE: Box = (0, 0, 0, 0)

_HALF = np.float32(0.5)


@compiled
def draw_nearest(
    points: Float32[ndarray, "v 3"],
    triangles: Int32[ndarray, "t 3"],
    front: float,
    backs: Box,
    label: tuple[float, float],
    nearest: Float32[ndarray, "h w"],
    seen: Float32[ndarray, "h w"],
) -> None:
    """Draws triangles where they are nearer than what is there.

    Args:
        points: Column, row and order of each vertex: samples lie at (column + 0.5, row + 0.5), and the smaller order
            is nearer. Triangles with a vertex that is not finite are left out.
        triangles: Corners.
        front: Sign of the area of triangles that show their front; 0 where both sides are drawn alike.
        backs: The box in which other triangles are drawn as well.
        label: a and b, so that triangle t leaves the number a + b t.
        nearest: Order of what is there; changed in place.
        seen: Number of what is there; changed in place.
    """
    height, width = nearest.shape
    start, step = np.float32(label[0]), np.float32(label[1])
    for t in range(len(triangles)):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
        bx, by, bz = points[j, 0], points[j, 1], points[j, 2]
        cx, cy, cz = points[k, 0], points[k, 1], points[k, 2]
        ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
        area = ux * vy - uy * vx
        left, top, right, bottom = 0, 0, width, height
        if area * front < 0:
            left, top, right, bottom = backs
        if area == 0 or left >= right or not np.isfinite(area + uz + vz):
            continue
        along_x, along_y = (uz * vy - vz * uy) / area, (vz * ux - uz * vx) / area
        # Compared before they are converted: what is too large for an integer has no defined conversion.
        first_row = int(min(max(np.ceil(min(ay, by, cy) - _HALF), top), bottom))
        end_row = int(min(np.ceil(max(ay, by, cy) - _HALF), bottom))
        for row in range(first_row, end_row):
            y = np.float32(row) + _HALF
            low, high = np.float32(np.inf), np.float32(-np.inf)
            for x in (_crossing(ax, ay, bx, by, y), _crossing(bx, by, cx, cy, y), _crossing(cx, cy, ax, ay, y)):
                low, high = x if x < low else low, x if x > high else high  # no comparison with NaN holds
            first = int(min(max(np.ceil(low - _HALF), left), right))
            end = int(min(np.ceil(high - _HALF), right))
            order = az + along_y * (y - ay) + along_x * (np.float32(first) + _HALF - ax)
            for column in range(first, end):
                if order < nearest[row, column]:
                    nearest[row, column] = order
                    seen[row, column] = start + step * np.float32(t)
                order += along_x


@compiled
def _crossing(ax: float, ay: float, bx: float, by: float, y: float) -> float:
    """Where an edge crosses the line at y, or NaN; the same bits in both directions, so no sample lies between."""
    if (y >= ay) == (y >= by):
        return np.float32(np.nan)
    if ay > by:
        ax, ay, bx, by = bx, by, ax, ay
    return ax + (bx - ax) * ((y - ay) / (by - ay))
