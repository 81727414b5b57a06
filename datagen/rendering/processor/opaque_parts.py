"""Draws what is opaque of transparent meshes such as hair: their shadows."""

import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled
from datagen.rendering.processor.nearest import by_row

_HALF, _ONE = np.float32(0.5), np.float32(1)


@compiled
def draw_opaque_parts(
    points: Float32[ndarray, "v 3"],
    triangles: Int32[ndarray, "t 3"],
    surface: Float32[ndarray, "v 4"],
    texture: Float32[ndarray, "h w 2"],
    opacity: tuple[float, float],
    nearest: Float32[ndarray, "H W"],
) -> None:
    """Draws both sides of triangles where they are opaque enough, and nearer than what is there.

    Args:
        points: Column, row and order of each vertex, as for `draw_nearest`.
        triangles: Corners.
        surface: Texture coordinates of each vertex, and how far it is above the cut and within the thin crown, mm.
        texture: Grey and alpha; repeats.
        opacity: Density, as in ``hair.glsl``, and the alpha from which on something is drawn.
        nearest: Order of what is there; changed in place.
    """
    height, width = nearest.shape
    right, bottom = np.float32(width), np.float32(height)
    density, least = np.float32(opacity[0]) - _ONE, np.float32(opacity[1])
    for t in range(len(triangles)):
        i, j, k = np.uint32(triangles[t, 0]), np.uint32(triangles[t, 1]), np.uint32(triangles[t, 2])
        ax, ay, bx, by, cx, cy = points[i, 0], points[i, 1], points[j, 0], points[j, 1], points[k, 0], points[k, 1]
        first_row = int(min(max(np.ceil(min(ay, by, cy) - _HALF), np.float32(0)), bottom))
        end_row = int(min(np.ceil(max(ay, by, cy) - _HALF), bottom))
        sides = bx - ax, by - ay, cx - ax, cy - ay
        area = sides[0] * sides[3] - sides[1] * sides[2]
        if first_row >= end_row or area == 0 or not np.isfinite(area):
            continue
        order_x, order_y = _slopes(points[i, 2], points[j, 2], points[k, 2], sides)
        u_x, u_y = _slopes(surface[i, 0], surface[j, 0], surface[k, 0], sides)
        v_x, v_y = _slopes(surface[i, 1], surface[j, 1], surface[k, 1], sides)
        cut_x, cut_y = _slopes(surface[i, 2], surface[j, 2], surface[k, 2], sides)
        thin_x, thin_y = _slopes(surface[i, 3], surface[j, 3], surface[k, 3], sides)
        high_x, high_y, middle_x, middle_y, low_x, low_y = by_row(ax, ay, bx, by, cx, cy)
        long = (low_x - high_x) / (low_y - high_y)
        upper, lower = (middle_x - high_x) / (middle_y - high_y), (low_x - middle_x) / (low_y - middle_y)
        for row in range(np.uint32(first_row), np.uint32(end_row)):
            y = np.float32(row) + _HALF
            one = high_x + (y - high_y) * long
            other = high_x + (y - high_y) * upper if y < middle_y else middle_x + (y - middle_y) * lower
            first = int(min(max(np.ceil(min(one, other) - _HALF), np.float32(0)), right))
            end = int(min(np.ceil(max(one, other) - _HALF), right))
            for place in range(first, end):
                column, across, down = np.uint32(place), np.float32(place) + _HALF - ax, y - ay
                order = points[i, 2] + order_x * across + order_y * down
                if not order < nearest[row, column]:
                    continue
                u, v = surface[i, 0] + u_x * across + u_y * down, surface[i, 1] + v_x * across + v_y * down
                grey, alpha = _texel(texture, u, v)
                alpha += density * (np.float32(1.5) - grey) * _smooth(alpha / np.float32(0.15))
                cut = surface[i, 2] + cut_x * across + cut_y * down + np.float32(8) * (grey - _HALF)
                thin = surface[i, 3] + thin_x * across + thin_y * down
                alpha = min(max(alpha, np.float32(0)), _ONE) * _smooth(np.float32(0.25) * cut + _HALF)
                alpha *= _ONE - np.float32(0.97) * _smooth((thin + np.float32(25)) / np.float32(30))
                if alpha >= least:
                    nearest[row, column] = order


@compiled
def _slopes(a: float, b: float, c: float, sides: tuple[float, float, float, float]) -> tuple[float, float]:
    """How a number of a triangle's corners changes from column to column and from row to row."""
    ux, uy, vx, vy = sides
    area = ux * vy - uy * vx
    return ((b - a) * vy - (c - a) * uy) / area, ((c - a) * ux - (b - a) * vx) / area


@compiled
def _smooth(share: float) -> float:
    """Goes smoothly from 0 to 1, as ``smoothstep``."""
    share = min(max(share, np.float32(0)), _ONE)
    return share * share * (np.float32(3) - np.float32(2) * share)


@compiled
def _texel(texture: ndarray, u: float, v: float) -> tuple[float, float]:
    """Both channels of a texture, mixed from its four nearest texels."""
    left, right, x = _between(u, texture.shape[1])
    top, bottom, y = _between(v, texture.shape[0])
    upper, lower = texture[top], texture[bottom]
    grey = (_ONE - y) * ((_ONE - x) * upper[left, 0] + x * upper[right, 0])
    grey += y * ((_ONE - x) * lower[left, 0] + x * lower[right, 0])
    alpha = (_ONE - y) * ((_ONE - x) * upper[left, 1] + x * upper[right, 1])
    alpha += y * ((_ONE - x) * lower[left, 1] + x * lower[right, 1])
    return grey, alpha


@compiled
def _between(u: float, n: int) -> tuple[int, int, float]:
    """The texels on both sides of a texture coordinate, and the share of the second."""
    place = (u - np.floor(u)) * np.float32(n) - _HALF
    place += np.float32(n) if place < 0 else np.float32(0)
    first = min(int(place), n - 1)
    return np.uint32(first), np.uint32(0 if first + 1 == n else first + 1), place - np.float32(first)
