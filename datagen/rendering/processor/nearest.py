"""Finds what is nearest in pictures of scenes: a z-buffer for the samples of a picture and for shadow maps.

A triangle is cut into rows, and a row into the samples between its edges, so that a sample costs one comparison. The
fixed pipeline of a software driver takes three to five times as long for the small triangles of a face.
"""

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled

Box = tuple[int, int, int, int]  # left, top, right, bottom; the last two are excluded
NOWHERE: Box = (0, 0, 0, 0)

_HALF = np.float32(0.5)
# Margins: OpenGL rounds vertices to a grid of 1/256 px, and depths to steps of 2^-24.
_GRID_PX, _GRID_DEPTH = np.float32(1 / 128), np.float32(1e-6)


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
    whole = np.float32(0), np.float32(0), np.float32(width), np.float32(height)
    behind = np.float32(backs[0]), np.float32(backs[1]), np.float32(backs[2]), np.float32(backs[3])
    start, step, side = np.float32(label[0]), np.float32(label[1]), np.float32(front)
    for t in range(len(triangles)):
        # With unsigned indices, the compiler leaves out the test for negative ones.
        i, j, k = np.uint32(triangles[t, 0]), np.uint32(triangles[t, 1]), np.uint32(triangles[t, 2])
        ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
        bx, by, bz = points[j, 0], points[j, 1], points[j, 2]
        cx, cy, cz = points[k, 0], points[k, 1], points[k, 2]
        ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
        area = ux * vy - uy * vx
        left, top, right, bottom = behind if area * side < 0 else whole
        if area == 0 or left >= right or not np.isfinite(area + uz + vz):
            continue
        # Compared before they are converted: what is too large for an integer has no defined conversion.
        first_row = int(min(max(np.ceil(min(ay, by, cy) - _HALF), top), bottom))
        end_row = int(min(np.ceil(max(ay, by, cy) - _HALF), bottom))
        if first_row >= end_row:
            continue
        along_x, along_y = (uz * vy - vz * uy) / area, (vz * ux - uz * vx) / area
        # From top to bottom, so that two triangles compute a common edge alike and no sample lies between them.
        high_x, high_y, middle_x, middle_y, low_x, low_y = _by_row(ax, ay, bx, by, cx, cy)
        long = (low_x - high_x) / (low_y - high_y)
        upper, lower = (middle_x - high_x) / (middle_y - high_y), (low_x - middle_x) / (low_y - middle_y)
        value = start + step * np.float32(t)
        for row in range(np.uint32(first_row), np.uint32(end_row)):
            y = np.float32(row) + _HALF
            one = high_x + (y - high_y) * long
            other = high_x + (y - high_y) * upper if y < middle_y else middle_x + (y - middle_y) * lower
            first = int(min(max(np.ceil(min(one, other) - _HALF), left), right))
            end = int(min(np.ceil(max(one, other) - _HALF), right))
            order = az + along_y * (y - ay) + along_x * (np.float32(first) + _HALF - ax)
            for place in range(first, end):
                column = np.uint32(place)
                if order < nearest[row, column]:
                    nearest[row, column] = order
                    seen[row, column] = value
                order += along_x


@compiled
def _by_row(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float
) -> tuple[float, float, float, float, float, float]:
    """Sorts three corners from top to bottom."""
    if by < ay:
        ax, ay, bx, by = bx, by, ax, ay
    if cy < by:
        bx, by, cx, cy = cx, cy, bx, by
        if by < ay:
            ax, ay, bx, by = bx, by, ax, ay
    return ax, ay, bx, by, cx, cy


@compiled
def may_be_seen(
    placed: Float32[ndarray, "v 3"], triangles: Int32[ndarray, "t 3"], farthest: Float32[ndarray, "h w"]
) -> Bool[ndarray, " t"]:
    """Finds the triangles that OpenGL would draw in at least one pixel, and possibly a few more.

    Args:
        placed: Vertices as `in_window` returns them.
        triangles: Corners.
        farthest: Depth in the buffer, for each pixel, behind which nothing is drawn.
    """
    height, width = farthest.shape
    found = np.empty(len(triangles), np.bool_)
    for t in range(len(triangles)):
        i, j, k = np.uint32(triangles[t, 0]), np.uint32(triangles[t, 1]), np.uint32(triangles[t, 2])
        ax, ay, az = placed[i, 0], placed[i, 1], placed[i, 2]
        bx, by, bz = placed[j, 0], placed[j, 1], placed[j, 2]
        cx, cy, cz = placed[k, 0], placed[k, 1], placed[k, 2]
        found[t] = not np.isfinite(ax + ay + bx + by + cx + cy)  # a corner behind the camera
        if found[t]:
            continue
        nearest = min(az, bz, cz) - _GRID_DEPTH
        first_row = int(max(np.ceil(min(ay, by, cy) - _GRID_PX - _HALF), 0))
        end_row = int(min(np.floor(max(ay, by, cy) + _GRID_PX + _HALF), height))
        first = int(max(np.ceil(min(ax, bx, cx) - _GRID_PX - _HALF), 0))
        end = int(min(np.floor(max(ax, bx, cx) + _GRID_PX + _HALF), width))
        for row in range(first_row, end_row):
            for column in range(first, end):
                found[t] |= nearest <= farthest[row, column]
            if found[t]:
                break
    return found


@compiled
def in_window(
    points: Float32[ndarray, "v 3"], clip_from_model: Float64[ndarray, "4 4"], height: int, width: int
) -> Float32[ndarray, "v 3"]:
    """Column and row (px) of vertices and their depth in the buffer, 0 to 1; NaN behind a pinhole."""
    clip = clip_from_model.astype(np.float32)
    placed = np.empty((len(points), 3), np.float32)
    for v in range(len(points)):
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        w = clip[3, 0] * x + clip[3, 1] * y + clip[3, 2] * z + clip[3, 3]
        half = np.float32(0.5) / w if w > 0 else np.float32(np.nan)
        placed[v, 0] = ((clip[0, 0] * x + clip[0, 1] * y + clip[0, 2] * z + clip[0, 3]) * half + _HALF) * width
        placed[v, 1] = ((clip[1, 0] * x + clip[1, 1] * y + clip[1, 2] * z + clip[1, 3]) * half + _HALF) * height
        placed[v, 2] = (clip[2, 0] * x + clip[2, 1] * y + clip[2, 2] * z + clip[2, 3]) * half + _HALF
    return placed
