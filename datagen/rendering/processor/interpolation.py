"""Turns the triangle that each pixel sees into maps and layers, on the processor: everything once a pixel."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled
from datagen.rendering.processor.visibility import QUEUE, STRIDE, Mesh

f32 = np.float32
# Where the numbers of some pixels begin: column, row and order of the corners, their points on the mean face, the
# column of the pixel centre. One array holds all, at distances that the compiler knows, or it would not use vector
# instructions.
AX, AY, AZ, BX, BY, BZ, CX, CY, CZ, A_MEAN, _, _, B_MEAN, _, _, C_MEAN, _, _, X, GIVEN = range(0, 20 * STRIDE, STRIDE)
# Of the results: weights of the corners, depth relative to order 0, PNCC, offset, above 0 where the outside shows.
A_WEIGHT, B_WEIGHT, C_WEIGHT, DEPTH, PNCC, _, _, OFFSET, _, _, OUTSIDE, FOUND = range(0, 12 * STRIDE, STRIDE)
MAGNITUDE = np.int32(0x7FFFFFFF)  # all bits of a float32 but its sign; as integers they order by magnitude


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

    mean: ndarray  # (v, 3) float32, mm
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
def draw_maps(seen: ndarray, mesh: Mesh, surface: Surface, way: WayBack, steps_per_mm: float, maps: Maps) -> float:
    """Draws the maps from the triangle that each pixel sees, (h, w) int32.

    PNCC and offset are in steps, rounded to whole numbers; with 0 steps per mm they are in mm.

    Returns:
        The largest magnitude among them. Where it is beyond what the arrays can hold, they are undefined.
    """
    height, width = seen.shape
    given, found, shown = np.empty(GIVEN, f32), np.empty(FOUND, f32), np.empty(STRIDE, np.int32)
    largest, steps = np.int32(0), f32(steps_per_mm)
    for row in range(height):
        first, end = _ends(seen[row])
        _clear(maps, row, 0, first)
        _clear(maps, row, end, width)
        for column in range(first, end, QUEUE):
            pixels = Pixels(row, column, seen[row, column : min(column + QUEUE, end)], shown)
            _gather(pixels, mesh, surface, given)
            _weigh(given, pixels, way, found)
            _place(given, pixels, way, found)
            if steps > 0:
                for k in range(PNCC, OUTSIDE):
                    found[k] = np.rint(found[k] * steps)
            largest = max(largest, _cut(pixels, found.view(np.int32), found))
            _write(pixels, found, way.reference_mm, maps)
    return np.array([largest], np.int32).view(f32)[0]


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
def _clear(maps: Maps, row: int, first: int, end: int) -> None:
    """Fills pixels of a row that see nothing."""
    maps.pncc[row, first:end], maps.offset[row, first:end], maps.mask[row, first:end] = 0, 0, False
    maps.depth[row, first:end], maps.surface_depth[row, first:end] = f32(0), f32(np.inf)


@compiled
def _gather(pixels: Pixels, mesh: Mesh, surface: Surface, given: ndarray) -> None:
    """Collects the corners of the triangles that some pixels see; of triangle 0 where they see none."""
    screen, triangles = mesh
    mean = surface.mean
    for k in range(len(pixels.seen)):
        triangle = np.uint32(max(pixels.seen[k], 0))
        a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
        given[AX + k], given[AY + k], given[AZ + k] = screen[a, 0], screen[a, 1], screen[a, 2]
        given[BX + k], given[BY + k], given[BZ + k] = screen[b, 0], screen[b, 1], screen[b, 2]
        given[CX + k], given[CY + k], given[CZ + k] = screen[c, 0], screen[c, 1], screen[c, 2]
        given[A_MEAN + k], given[A_MEAN + STRIDE + k], given[A_MEAN + 2 * STRIDE + k] = (
            mean[a, 0],
            mean[a, 1],
            mean[a, 2],
        )
        given[B_MEAN + k], given[B_MEAN + STRIDE + k], given[B_MEAN + 2 * STRIDE + k] = (
            mean[b, 0],
            mean[b, 1],
            mean[b, 2],
        )
        given[C_MEAN + k], given[C_MEAN + STRIDE + k], given[C_MEAN + 2 * STRIDE + k] = (
            mean[c, 0],
            mean[c, 1],
            mean[c, 2],
        )
        pixels.shown[k] = -np.int32(surface.is_face[triangle] & (pixels.seen[k] >= 0))
    for k in range(len(pixels.seen)):
        given[X + k] = f32(np.int32(pixels.column + k)) + f32(0.5)


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
        found[OUTSIDE + k] = area * outside


@compiled
def _place(given: ndarray, pixels: Pixels, way: WayBack, found: ndarray) -> None:
    """PNCC, and the offset from it to where the ray through the pixel centre meets the depth."""
    y = f32(pixels.row) + f32(0.5)
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
            found[PNCC + at + k] = mean
            found[OFFSET + at + k] = point - mean


@compiled
def _cut(pixels: Pixels, bits: ndarray, found: ndarray) -> int:
    """Sets PNCC and offset to 0 outside the mask, and returns their largest magnitude as bits.

    ``bits`` is ``found`` seen as int32: the compiler finds a maximum with vector instructions only for integers.
    """
    shown, largest = pixels.shown, np.int32(0)
    for k in range(len(pixels.seen)):
        shown[k] &= -np.int32(found[OUTSIDE + k] > 0)
    for part in range(PNCC, OUTSIDE, STRIDE):
        for k in range(len(pixels.seen)):
            value = bits[part + k] & shown[k]
            bits[part + k] = value
            largest = max(largest, value & MAGNITUDE)
    return largest


@compiled
def _write(pixels: Pixels, found: ndarray, reference_mm: float, maps: Maps) -> None:
    """Writes the results of some pixels into the maps."""
    row, column, n, shown = pixels.row, pixels.column, len(pixels.seen), pixels.shown
    pncc, offset = maps.pncc[row, column:].reshape(-1), maps.offset[row, column:].reshape(-1)
    for k in range(n):
        x, y, z = found[PNCC + k], found[PNCC + STRIDE + k], found[PNCC + 2 * STRIDE + k]
        pncc[3 * k], pncc[3 * k + 1], pncc[3 * k + 2] = x, y, z
    for k in range(n):
        x, y, z = found[OFFSET + k], found[OFFSET + STRIDE + k], found[OFFSET + 2 * STRIDE + k]
        offset[3 * k], offset[3 * k + 1], offset[3 * k + 2] = x, y, z
    mask, depth, surface_depth = maps.mask[row, column:], maps.depth[row, column:], maps.surface_depth[row, column:]
    for k in range(n):
        mask[k] = shown[k] != 0
        distance = found[DEPTH + k] + reference_mm
        depth[k] = distance if shown[k] != 0 else f32(0)
        surface_depth[k] = distance if pixels.seen[k] >= 0 else f32(np.inf)
    if maps.weights.size > 0:
        for k in range(n):
            for corner in range(3):
                maps.weights[row, column + k, corner] = found[A_WEIGHT + corner * STRIDE + k]


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
