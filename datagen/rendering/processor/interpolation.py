"""Turns the triangle that each pixel sees into maps and layers, on the processor: everything once a pixel."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled
from datagen.rendering.processor.transposing import transpose
from datagen.rendering.processor.visibility import QUEUE, STRIDE, Mesh

f32 = np.float32
# Where the numbers of some pixels begin: column, row and order of the corners, their points on the mean face, the
# column of the pixel centre. One array holds all, at distances that the compiler knows, or it would not use vector
# instructions.
AX, AY, AZ, BX, BY, BZ, CX, CY, CZ, A_MEAN, _, _, B_MEAN, _, _, C_MEAN, _, _, X, GIVEN = range(0, 20 * STRIDE, STRIDE)
# Of the results: weights of the corners, depth relative to order 0, PNCC, offset.
A_WEIGHT, B_WEIGHT, C_WEIGHT, DEPTH, PNCC, _, _, OFFSET, _, _, FOUND = range(0, 11 * STRIDE, STRIDE)


class WayBack(NamedTuple):
    """From pixels to the model frame: fields of ``ScreenProjection``, in float32."""

    middle: ndarray
    middle_point: ndarray
    along_column: ndarray
    along_row: ndarray
    along_depth: ndarray
    inverse_distance: np.float32
    outside_sign: np.float32
    reference_mm: np.float32


class Surface(NamedTuple):
    """What is known of a model's mesh."""

    mean: ndarray  # (v, 4) float32, mm; the fourth number is not read
    is_face: ndarray  # of each triangle, (t,) bool


class Maps(NamedTuple):
    """What is drawn; everything is filled."""

    pncc: ndarray  # (h, w, 3), float32 in mm, or int16 in steps
    offset: ndarray  # likewise
    mask: ndarray  # (h, w) bool
    depth: ndarray  # (h, w) float32, mm
    surface_depth: ndarray  # (h, w) float32, mm
    weights: ndarray  # of the corners at each pixel that sees something, (h, w, 3) float32; empty: not wanted


class Pixels(NamedTuple):
    """Consecutive pixels of a row."""

    row: int
    column: int  # of the first
    seen: ndarray  # the triangle that each sees, int32; -1 where there is none
    shown: ndarray  # -1 (all bits set) where the outside of the face is seen, otherwise 0; int32, may be longer


@compiled
def draw_maps(seen: ndarray, mesh: Mesh, surface: Surface, way: WayBack, steps_per_mm: float, maps: Maps) -> None:
    """Draws the maps from the triangle that each pixel sees, (h, w) int32.

    PNCC and offset are in steps, rounded to whole numbers, which the arrays must be able to hold; with 0 steps per mm
    they are in mm.
    """
    height, width = seen.shape
    given, found, shown = np.empty(GIVEN, f32), np.empty(FOUND, f32), np.empty(STRIDE, np.int32)
    # Slices of flat arrays are consecutive to the compiler, and cost less: a sixth of this function.
    flat_mesh = Mesh(mesh.screen.reshape(-1), mesh.triangles.reshape(-1))
    flat_surface = Surface(surface.mean.reshape(-1), surface.is_face)
    flat = Maps(
        maps.pncc.reshape(-1),
        maps.offset.reshape(-1),
        maps.mask.reshape(-1),
        maps.depth.reshape(-1),
        maps.surface_depth.reshape(-1),
        maps.weights.reshape(-1),
    )
    triangle = seen.reshape(-1)
    for row in range(height):
        start = row * width
        first, end = _ends(triangle[start : start + width])
        _clear(flat, start, start + first)
        _clear(flat, start + end, start + width)
        for column in range(first, end, QUEUE):
            pixels = Pixels(row, column, triangle[start + column : start + min(column + QUEUE, end)], shown)
            _gather(pixels, flat_mesh, flat_surface, given)
            _weigh(given, pixels, way, found)
            _place(given, pixels, way, f32(steps_per_mm), found)
            _write(pixels, start + column, found, way.reference_mm, flat)


@compiled
def _ends(seen: ndarray) -> tuple[int, int]:
    """The first column of a row that sees something, and the one behind the last."""
    first, end = 0, len(seen)
    while first < end and seen[first] < 0:
        first += 1
    while end > first and seen[end - 1] < 0:
        end -= 1
    return first, end


@compiled
def _clear(maps: Maps, first: int, end: int) -> None:
    """Fills pixels of flat maps that see nothing, by their numbers."""
    maps.pncc[3 * first : 3 * end] = 0
    maps.offset[3 * first : 3 * end] = 0
    maps.mask[first:end] = False
    maps.depth[first:end] = f32(0)
    maps.surface_depth[first:end] = f32(np.inf)


@compiled
def _gather(pixels: Pixels, mesh: Mesh, surface: Surface, given: ndarray) -> None:
    """Collects the corners of the triangles that some pixels see; of triangle 0 where they see none.

    Mesh and surface are flat. Pixels are collected by fours: the last one several times, if need be.
    """
    screen, triangles, mean = mesh.screen, mesh.triangles, surface.mean
    seen, last = pixels.seen, len(pixels.seen) - 1
    for k in range(0, len(seen), 4):
        p, q = 3 * np.int64(max(seen[k], 0)), 3 * np.int64(max(seen[min(k + 1, last)], 0))
        r, s = 3 * np.int64(max(seen[min(k + 2, last)], 0)), 3 * np.int64(max(seen[min(k + 3, last)], 0))
        for corner in range(3):
            a, b = 4 * np.int64(triangles[p + corner]), 4 * np.int64(triangles[q + corner])
            c, d = 4 * np.int64(triangles[r + corner]), 4 * np.int64(triangles[s + corner])
            transpose(screen, (a, b, c, d), given, AX + 3 * STRIDE * corner + k, STRIDE)
            transpose(mean, (a, b, c, d), given, A_MEAN + 3 * STRIDE * corner + k, STRIDE)
    for k in range(len(seen)):
        given[X + k] = f32(np.int32(pixels.column + k)) + f32(0.5)
    for k in range(len(seen)):
        pixels.shown[k] = -np.int32(surface.is_face[np.uint32(max(seen[k], 0))] & (seen[k] >= 0))


@compiled
def _weigh(given: ndarray, pixels: Pixels, way: WayBack, found: ndarray) -> None:
    """Weights of the corners on the surface (perspective-correct) and the depth at each pixel centre."""
    inverse, outside, one, y = way.inverse_distance, way.outside_sign, f32(1), f32(pixels.row) + f32(0.5)
    for k in range(len(pixels.seen)):
        ax, ay = given[AX + k] - given[X + k], given[AY + k] - y
        bx, by = given[BX + k] - given[X + k], given[BY + k] - y
        cx, cy = given[CX + k] - given[X + k], given[CY + k] - y
        sa, sb, sc = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
        area = sa + sb + sc
        share = one / area
        a, b, c = sa * share, sb * share, sc * share
        order = a * given[AZ + k] + b * given[BZ + k] + c * given[CZ + k]
        a *= one - given[AZ + k] * inverse
        b *= one - given[BZ + k] * inverse
        c *= one - given[CZ + k] * inverse
        share = one / (a + b + c)
        found[A_WEIGHT + k], found[B_WEIGHT + k], found[C_WEIGHT + k] = a * share, b * share, c * share
        found[DEPTH + k] = order / (one - order * inverse)
        pixels.shown[k] &= -np.int32(area * outside > 0)


@compiled
def _place(given: ndarray, pixels: Pixels, way: WayBack, steps: float, found: ndarray) -> None:
    """PNCC, and the offset from it to where the ray through the pixel centre meets the depth; 0 outside the mask."""
    y, scale = f32(pixels.row) + f32(0.5), steps if steps > 0 else f32(1)
    for axis in range(3):
        at = axis * STRIDE
        start, along_column, along_row = way.middle_point[axis], way.along_column[axis], way.along_row[axis]
        along_depth, inverse = way.along_depth[axis], way.inverse_distance
        for k in range(len(pixels.seen)):
            across = (given[X + k] - way.middle[0]) * along_column + (y - way.middle[1]) * along_row
            point = start + across + found[DEPTH + k] * (along_depth + inverse * across)
            mean = (
                found[A_WEIGHT + k] * given[A_MEAN + at + k]
                + found[B_WEIGHT + k] * given[B_MEAN + at + k]
                + found[C_WEIGHT + k] * given[C_MEAN + at + k]
            )
            found[PNCC + at + k] = mean * scale if pixels.shown[k] != 0 else f32(0)
            found[OFFSET + at + k] = (point - mean) * scale if pixels.shown[k] != 0 else f32(0)
    if steps > 0:
        for k in range(PNCC, FOUND):
            found[k] = np.rint(found[k])


@compiled
def _write(pixels: Pixels, first: int, found: ndarray, reference_mm: float, maps: Maps) -> None:
    """Writes the results of some pixels, of which the first has this number, into flat maps."""
    n, shown, seen = len(pixels.seen), pixels.shown, pixels.seen
    pncc, offset = maps.pncc[3 * first :], maps.offset[3 * first :]
    for k in range(n):
        x, y, z = found[PNCC + k], found[PNCC + STRIDE + k], found[PNCC + 2 * STRIDE + k]
        pncc[3 * k], pncc[3 * k + 1], pncc[3 * k + 2] = x, y, z
    for k in range(n):
        x, y, z = found[OFFSET + k], found[OFFSET + STRIDE + k], found[OFFSET + 2 * STRIDE + k]
        offset[3 * k], offset[3 * k + 1], offset[3 * k + 2] = x, y, z
    mask, depth, surface_depth = maps.mask[first:], maps.depth[first:], maps.surface_depth[first:]
    for k in range(n):
        mask[k] = shown[k] != 0
        distance = found[DEPTH + k] + reference_mm
        depth[k] = distance if shown[k] != 0 else f32(0)
        surface_depth[k] = distance if seen[k] >= 0 else f32(np.inf)
    if maps.weights.size > 0:
        weights = maps.weights[3 * first :]
        for k in range(n):
            for corner in range(3):
                weights[3 * k + corner] = found[A_WEIGHT + corner * STRIDE + k]


@compiled
def interpolate(seen: ndarray, maps: Maps, values: ndarray, corners: ndarray, is_direction: bool, out: ndarray) -> None:
    """Interpolates what is given at corners, after ``draw_maps`` has left its weights.

    Args:
        seen: The triangle that each pixel sees, (h, w) int32.
        maps: Mask and weights.
        values: What is given, (n, c) float32.
        corners: For each triangle the rows of its values, (t, 3) uint32.
        is_direction: Whether the results get length 1.
        out: Is filled, (h, w, c) float32; 0 outside the mask.
    """
    height, width, n_channels = out.shape
    for row in range(height):
        for column in range(width):
            for channel in range(n_channels):
                out[row, column, channel] = f32(0)
            if not maps.mask[row, column]:
                continue
            triangle, squares = np.uint32(seen[row, column]), f32(0)
            for channel in range(n_channels):
                value = f32(0)
                for corner in range(3):
                    value += maps.weights[row, column, corner] * values[corners[triangle, corner], channel]
                out[row, column, channel] = value
                squares += value * value
            if is_direction and squares > 0:
                for channel in range(n_channels):
                    out[row, column, channel] /= np.sqrt(squares)
