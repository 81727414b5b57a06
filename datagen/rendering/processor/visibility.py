"""Finds the nearest triangle of each pixel on the processor, by the rules of the oracle.

Most triangles of a face are smaller than a pixel. A triangle whose corners have the same first column or row of pixel
centres behind them covers no centre, and is gone after one comparison. The others wait in queues by the size of their
bounding box. When a queue is full, the corners of its triangles are collected, and one pixel after the other of all its
boxes is tested, in a loop that the compiler turns into vector instructions. Float64 decides what float32 cannot:
centres on an edge, and surfaces of nearly the same depth.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled
from datagen.rendering.processor.transposing import transpose

f32 = np.float32
LOWER_HALF, HALF = np.uint32(0xFFFF), np.uint32(16)
# Number of boxes that are tested at a time: they fit into the fastest cache. The stride is no power of two, or the rows
# of numbers would share the same few lines of it, which takes three times as long.
QUEUE, STRIDE = 256, 272
# Each size of box has a queue. Boxes with a longer side are cut.
LONGEST_SIDE, N_SIZES = 4, 16
# Number of triangles whose boxes are measured at a time.
BLOCK = 1024
# Where the numbers of some boxes begin: the corners' column, row and order, and the first centre. One array holds all,
# at distances that the compiler knows.
AX, AY, AZ, BX, BY, BZ, CX, CY, CZ, X, Y, NUMBERS = range(0, 12 * STRIDE, STRIDE)


class Mesh(NamedTuple):
    """A projected mesh."""

    screen: ndarray  # column, row (px) and order (mm) of each vertex, (v, 4) float32; the fourth number is not read
    triangles: ndarray  # corners, (t, 3) uint32


class Seen(NamedTuple):
    """What each pixel sees."""

    order: ndarray  # of the nearest surface at the pixel centre, mm, (h, w) float32; infinite where there is none
    triangle: ndarray  # the nearest triangle, (h, w) int32; -1 where there is none


class Boxes(NamedTuple):
    """The bounding boxes of some triangles, (BLOCK + 1,) uint32 each.

    A place is one number: the column in the lower half, the row in the upper one.
    """

    triangle: ndarray
    first: ndarray  # the first pixel centre
    end: ndarray  # behind the last one
    size: ndarray  # number of the queue


class Queues(NamedTuple):
    """Boxes that wait to be tested, by their size, and what tests need."""

    triangle: ndarray  # (N_SIZES * QUEUE,) uint32
    first: ndarray  # column (lower half) and row of the first centre, (N_SIZES * QUEUE,) uint32
    waiting: ndarray  # how many boxes there are, (N_SIZES,) int64
    numbers: ndarray  # (NUMBERS,) float32
    order: ndarray  # of each box's triangle at the pixel that is tested, (STRIDE,) float32
    hits: ndarray  # boxes whose triangle may be seen there, (STRIDE,) uint32


@compiled
def see(mesh: Mesh, depth_error_mm: float, seen: Seen) -> None:
    """Finds the nearest triangle of each pixel.

    Args:
        mesh: The projected mesh.
        depth_error_mm: Orders in float32 that differ by more are known to be in the right sequence.
        seen: Is filled.
    """
    seen.order[:] = f32(np.inf)
    seen.triangle[:] = -1
    cells = _cells(mesh.screen, seen.triangle.shape[0], seen.triangle.shape[1])
    lists = np.empty((4, BLOCK + 1), np.uint32)
    boxes = Boxes(lists[0], lists[1], lists[2], lists[3])
    queued, numbers = np.empty((2, N_SIZES * QUEUE), np.uint32), np.empty(NUMBERS, f32)
    queues = Queues(
        queued[0], queued[1], np.zeros(N_SIZES, np.int64), numbers, np.empty(STRIDE, f32), np.empty(STRIDE, np.uint32)
    )
    for start in range(0, len(mesh.triangles), BLOCK):
        n = _keep(mesh.triangles[start : start + BLOCK], start, cells, boxes)
        _measure(boxes, n)
        for i in range(n):
            size = np.int64(boxes.size[i])
            if size < N_SIZES:
                if _put(queues, size, boxes.triangle[i], boxes.first[i]):
                    _test(queues, size, mesh, depth_error_mm, seen)
                continue
            first, end = boxes.first[i], boxes.end[i]
            for y in range(first >> HALF, end >> HALF, LONGEST_SIDE):
                for x in range(first & LOWER_HALF, end & LOWER_HALF, LONGEST_SIDE):
                    size = _size(np.int64(end & LOWER_HALF) - x, np.int64(end >> HALF) - y)
                    if _put(queues, size, boxes.triangle[i], x | (y << HALF)):
                        _test(queues, size, mesh, depth_error_mm, seen)
    for size in range(N_SIZES):
        _test(queues, size, mesh, depth_error_mm, seen)


@compiled
def _cells(screen: ndarray, height: int, width: int) -> ndarray:
    """The first column (lower half) and row of pixel centres that do not lie before each vertex, in the picture."""
    cells = np.empty(len(screen), np.uint32)
    right, bottom = f32(width), f32(height)
    places = screen.reshape(-1)  # with distances that the compiler knows
    for i in range(len(screen)):
        column = min(max(np.ceil(places[4 * i] - f32(0.5)), f32(0)), right)
        row = min(max(np.ceil(places[4 * i + 1] - f32(0.5)), f32(0)), bottom)
        cells[i] = np.uint32(np.int32(column)) | (np.uint32(np.int32(row)) << HALF)
    return cells


@compiled
def _keep(triangles: ndarray, start: int, cells: ndarray, boxes: Boxes) -> int:
    """Lists the triangles whose bounding box has a pixel centre, with the cells of their corners, and counts them."""
    n, corners = 0, triangles.reshape(-1)
    for i in range(len(triangles)):
        a, b, c = cells[corners[3 * i]], cells[corners[3 * i + 1]], cells[corners[3 * i + 2]]
        boxes.triangle[n], boxes.first[n], boxes.end[n], boxes.size[n] = start + i, a, b, c
        differ = (a ^ b) | (a ^ c)
        n += np.int64((differ & LOWER_HALF) != 0) & np.int64((differ >> HALF) != 0)
    return n


@compiled
def _measure(boxes: Boxes, n: int) -> None:
    """Computes the first n boxes from the cells that ``_keep`` has stored in them."""
    for i in range(n):
        a, b, c = boxes.first[i], boxes.end[i], boxes.size[i]
        ax, bx, cx, ay, by, cy = a & LOWER_HALF, b & LOWER_HALF, c & LOWER_HALF, a >> HALF, b >> HALF, c >> HALF
        left, right, top, bottom = min(ax, bx, cx), max(ax, bx, cx), min(ay, by, cy), max(ay, by, cy)
        columns, rows = right - left, bottom - top
        boxes.first[i], boxes.end[i] = left | (top << HALF), right | (bottom << HALF)
        is_cut = (columns > LONGEST_SIDE) | (rows > LONGEST_SIDE)
        boxes.size[i] = N_SIZES if is_cut else LONGEST_SIDE * (rows - 1) + columns - 1


@compiled
def _size(columns: int, rows: int) -> int:
    """The number of the queue for the first part of a box of this many columns and rows."""
    return LONGEST_SIDE * (min(rows, LONGEST_SIDE) - 1) + min(columns, LONGEST_SIDE) - 1


@compiled
def _put(queues: Queues, size: int, triangle: int, first: int) -> bool:
    """Puts a box into a queue, and returns whether the queue is full."""
    n = queues.waiting[size]
    queues.triangle[size * QUEUE + n], queues.first[size * QUEUE + n] = triangle, first
    queues.waiting[size] = n + 1
    return n + 1 == QUEUE


@compiled
def _test(queues: Queues, size: int, mesh: Mesh, depth_error_mm: float, seen: Seen) -> None:
    """Tests all pixels of the boxes in a queue, which is empty afterwards."""
    n, triangle, first = queues.waiting[size], queues.triangle[size * QUEUE :], queues.first[size * QUEUE :]
    order, hits, margin = queues.order, queues.hits, f32(depth_error_mm)
    width = np.uint32(seen.triangle.shape[1])
    nearest, triangles = seen.order.reshape(-1), seen.triangle.reshape(-1)
    queues.waiting[size] = 0
    _collect(triangle[:n], first, mesh, queues.numbers)
    for down in range(size // LONGEST_SIDE + 1):
        for right in range(size % LONGEST_SIDE + 1):
            n_hits = _cover(queues.numbers, n, f32(right), f32(down), order, hits)
            for k in range(n_hits):
                i = hits[k]
                column, row = (first[i] & LOWER_HALF) + np.uint32(right), (first[i] >> HALF) + np.uint32(down)
                pixel = np.uint32(row * width + column)
                z, before = order[i], nearest[pixel]
                if z > before + margin:
                    continue
                if not z < before - margin:  # too close to be told apart in float32, or on an edge (NaN)
                    place = column + 0.5, row + 0.5
                    if not _is_nearer(mesh, triangle[i], triangles[pixel], place):
                        continue
                    z = f32(_depth_at(mesh, triangle[i], place)[1])
                nearest[pixel] = z
                triangles[pixel] = triangle[i]


@compiled
def _collect(triangle: ndarray, first: ndarray, mesh: Mesh, numbers: ndarray) -> None:
    """Collects the corners of some triangles, by fours, and the first centres of their boxes."""
    screen, triangles, last = mesh.screen.reshape(-1), mesh.triangles.reshape(-1), len(triangle) - 1
    for i in range(0, len(triangle), 4):
        p, q = 3 * np.int64(triangle[i]), 3 * np.int64(triangle[min(i + 1, last)])
        r, s = 3 * np.int64(triangle[min(i + 2, last)]), 3 * np.int64(triangle[min(i + 3, last)])
        for corner in range(3):
            a, b = 4 * np.int64(triangles[p + corner]), 4 * np.int64(triangles[q + corner])
            c, d = 4 * np.int64(triangles[r + corner]), 4 * np.int64(triangles[s + corner])
            transpose(screen, (a, b, c, d), numbers, AX + 3 * STRIDE * corner + i, STRIDE)
    for i in range(len(triangle)):
        numbers[X + i] = f32(np.int32(first[i] & LOWER_HALF)) + f32(0.5)
        numbers[Y + i] = f32(np.int32(first[i] >> HALF)) + f32(0.5)


@compiled
def _cover(numbers: ndarray, n: int, right: float, down: float, order: ndarray, hits: ndarray) -> int:
    """Tests one pixel of each box: its order, infinite where it is not covered and NaN where it lies on an edge.

    Lists and counts the boxes where it is covered or on an edge.
    """
    for i in range(n):
        u, v = numbers[X + i] + right, numbers[Y + i] + down
        au, av = numbers[AX + i] - u, numbers[AY + i] - v
        bu, bv = numbers[BX + i] - u, numbers[BY + i] - v
        cu, cv = numbers[CX + i] - u, numbers[CY + i] - v
        # The same for an edge in both directions but for the sign, bit for bit: no centre is between two triangles.
        sa, sb, sc = bu * cv - bv * cu, cu * av - cv * au, au * bv - av * bu
        lowest = sa if sa < sb else sb
        lowest = lowest if lowest < sc else sc
        highest = sa if sa > sb else sb
        highest = highest if highest > sc else sc
        inside = lowest if lowest > -highest else -highest
        z = (sa * numbers[AZ + i] + sb * numbers[BZ + i] + sc * numbers[CZ + i]) / (sa + sb + sc)
        z = z if inside > f32(0) else f32(np.nan)
        order[i] = z if inside >= f32(0) else f32(np.inf)
    n_hits = 0
    for i in range(n):
        hits[n_hits] = i
        n_hits += np.int64(order[i] != f32(np.inf))
    return n_hits


@compiled
def _is_nearer(mesh: Mesh, triangle: int, other: int, place: tuple[float, float]) -> bool:
    """Whether a triangle is to be seen at a centre before another (-1: none): the lower number, at the same depth."""
    is_covered, order = _depth_at(mesh, triangle, place)
    if not is_covered or other < 0:
        return is_covered
    _, before = _depth_at(mesh, other, place)
    return order < before or (order == before and triangle < other)


@compiled
def _depth_at(mesh: Mesh, triangle: int, place: tuple[float, float]) -> tuple[bool, float]:
    """Whether a triangle covers a centre, and its order there. Of its edges, it has the left ones and the top one."""
    sides, edges = np.empty(3), np.empty((3, 2))
    for k in range(3):
        start, end = mesh.triangles[triangle, (k + 1) % 3], mesh.triangles[triangle, (k + 2) % 3]
        su, sv = mesh.screen[start, 0] - place[0], mesh.screen[start, 1] - place[1]
        eu, ev = mesh.screen[end, 0] - place[0], mesh.screen[end, 1] - place[1]
        sides[k], edges[k, 0], edges[k, 1] = su * ev - sv * eu, eu - su, ev - sv
    area = sides.sum()
    if area == 0:
        return False, np.inf
    is_covered, order = True, 0.0
    for k in range(3):
        weight, right, down = sides[k] / area, edges[k, 0] * np.sign(area), edges[k, 1] * np.sign(area)
        is_covered &= weight > 0 or (weight == 0 and (down < 0 or (down == 0 and right > 0)))
        order += weight * mesh.screen[mesh.triangles[triangle, k], 2]
    return is_covered, order
