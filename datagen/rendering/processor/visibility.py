"""Finds the nearest triangle of each pixel on the processor, by the rules of the oracle.

Most triangles of a face are smaller than a pixel. A triangle whose corners have the same first column or row of pixel
centres behind them covers no centre, and is gone after one comparison. The others wait in queues by the size of their
bounding box. When a queue is full, one pixel after the other of all its boxes is tested, in a loop that the compiler
turns into vector instructions. Float64 decides what float32 cannot: centres on an edge, and surfaces of nearly the same
depth.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled

f32 = np.float32
LOWER_HALF, HALF = np.uint32(0xFFFF), np.uint32(16)
# So many boxes are tested at a time: they fit into the fastest cache. The stride is no power of two, or the rows of a
# queue would share the same few lines of it, which takes three times as long.
QUEUE, STRIDE = 256, 272
# Boxes of up to 3 x 3 pixels have a queue for each size. Larger ones are cut into tiles, which share another.
LARGEST_BOX, TILE, TILES = 3, 4, 9
# Rows of a queue's numbers: the corners' column, row and order, and the first centre of the box.
AX, AY, AZ, BX, BY, BZ, CX, CY, CZ, X, Y = range(11)
# Rows of its whole numbers: first pixel, columns and rows of the box, triangle.
PIXEL, COLUMNS, ROWS, TRIANGLE = range(4)


class Mesh(NamedTuple):
    """A projected mesh."""

    screen: ndarray  # column, row (px) and order (mm) of each vertex, (v, 4) float32; the fourth number is not read
    triangles: ndarray  # corners, (t, 3) uint32


class Seen(NamedTuple):
    """What each pixel sees."""

    order: ndarray  # of the nearest surface at the pixel centre, mm, (h, w) float32; infinite where there is none
    triangle: ndarray  # the nearest triangle, (h, w) int32; -1 where there is none


class Queue(NamedTuple):
    """Boxes of triangles to be tested."""

    numbers: ndarray  # (11, STRIDE) float32
    whole: ndarray  # (4, STRIDE) int32


@compiled
def see(mesh: Mesh, depth_error_mm: float, seen: Seen) -> None:
    """Finds the nearest triangle of each pixel.

    Args:
        mesh: The projected mesh.
        depth_error_mm: Orders in float32 that differ by more are known to be in the right sequence.
        seen: Is filled.
    """
    height, width = seen.triangle.shape
    seen.order[:] = f32(np.inf)
    seen.triangle[:] = -1
    cells = _cells(mesh.screen, height, width)
    kept = np.empty(len(mesh.triangles) + 1, np.uint32)
    n_kept = _keep(mesh.triangles, cells, kept)
    numbers, whole = np.empty((TILES + 1, 11, STRIDE), f32), np.empty((TILES + 1, 4, STRIDE), np.int32)
    waiting = np.zeros(TILES + 1, np.int64)
    for index in range(n_kept):
        triangle = kept[index]
        left, top, right, bottom = _box(cells, mesh.triangles, triangle)
        columns, rows = right - left, bottom - top
        if columns <= LARGEST_BOX and rows <= LARGEST_BOX:
            number = columns - 1 + LARGEST_BOX * (rows - 1)
            queue = Queue(numbers[number], whole[number])
            _put(queue, waiting[number], mesh, triangle, (left, top, right, bottom, top * width + left))
            waiting[number] += 1
            if waiting[number] == QUEUE:
                _test(queue, QUEUE, columns, rows, mesh, depth_error_mm, seen)
                waiting[number] = 0
            continue
        queue = Queue(numbers[TILES], whole[TILES])
        for y in range(top, bottom, TILE):
            for x in range(left, right, TILE):
                _put(queue, waiting[TILES], mesh, triangle, (x, y, right, bottom, y * width + x))
                waiting[TILES] += 1
                if waiting[TILES] == QUEUE:
                    _test(queue, QUEUE, TILE, TILE, mesh, depth_error_mm, seen)
                    waiting[TILES] = 0
    for number in range(TILES + 1):
        columns, rows = (number % LARGEST_BOX + 1, number // LARGEST_BOX + 1) if number < TILES else (TILE, TILE)
        _test(Queue(numbers[number], whole[number]), waiting[number], columns, rows, mesh, depth_error_mm, seen)


@compiled
def _cells(screen: ndarray, height: int, width: int) -> ndarray:
    """The first column (lower half) and row of pixel centres that do not lie before each vertex, in the picture."""
    cells = np.empty(len(screen), np.uint32)
    right, bottom = f32(width), f32(height)
    for i in range(len(screen)):
        column = min(max(np.ceil(screen[i, 0] - f32(0.5)), f32(0)), right)
        row = min(max(np.ceil(screen[i, 1] - f32(0.5)), f32(0)), bottom)
        cells[i] = np.uint32(np.int32(column)) | (np.uint32(np.int32(row)) << HALF)
    return cells


@compiled
def _keep(triangles: ndarray, cells: ndarray, kept: ndarray) -> int:
    """Lists the triangles whose bounding box has a pixel centre, and counts them."""
    n = 0
    for triangle in range(len(triangles)):
        a = cells[triangles[triangle, 0]]
        differ = (a ^ cells[triangles[triangle, 1]]) | (a ^ cells[triangles[triangle, 2]])
        kept[n] = triangle
        n += np.int64((differ & LOWER_HALF) != 0) & np.int64((differ >> HALF) != 0)
    return n


@compiled
def _box(cells: ndarray, triangles: ndarray, triangle: int) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the pixel centres in a triangle's bounding box; the last two are excluded."""
    a, b, c = cells[triangles[triangle, 0]], cells[triangles[triangle, 1]], cells[triangles[triangle, 2]]
    ax, bx, cx = a & LOWER_HALF, b & LOWER_HALF, c & LOWER_HALF
    ay, by, cy = a >> HALF, b >> HALF, c >> HALF
    left, right = min(ax, bx, cx), max(ax, bx, cx)
    top, bottom = min(ay, by, cy), max(ay, by, cy)
    return np.int32(left), np.int32(top), np.int32(right), np.int32(bottom)


@compiled
def _put(queue: Queue, i: int, mesh: Mesh, triangle: int, box: tuple[int, int, int, int, int]) -> None:
    """Puts a box (left, top, right, bottom, first pixel) of a triangle into a queue."""
    numbers, whole = queue
    screen, triangles = mesh
    left, top, right, bottom, pixel = box
    a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
    numbers[AX, i], numbers[AY, i], numbers[AZ, i] = screen[a, 0], screen[a, 1], screen[a, 2]
    numbers[BX, i], numbers[BY, i], numbers[BZ, i] = screen[b, 0], screen[b, 1], screen[b, 2]
    numbers[CX, i], numbers[CY, i], numbers[CZ, i] = screen[c, 0], screen[c, 1], screen[c, 2]
    numbers[X, i], numbers[Y, i] = f32(left) + f32(0.5), f32(top) + f32(0.5)
    whole[PIXEL, i], whole[TRIANGLE, i] = pixel, triangle
    whole[COLUMNS, i], whole[ROWS, i] = right - left, bottom - top


@compiled
def _test(queue: Queue, n: int, columns: int, rows: int, mesh: Mesh, depth_error_mm: float, seen: Seen) -> None:
    """Tests all pixels of the first n boxes of a queue."""
    width = seen.triangle.shape[1]
    nearest, triangles = seen.order.reshape(-1), seen.triangle.reshape(-1)
    order, hits = np.empty(STRIDE, f32), np.empty(STRIDE, np.uint32)
    margin = f32(depth_error_mm)
    for down in range(rows):
        for right in range(columns):
            n_hits = _cover(queue, n, np.int32(right), np.int32(down), order, hits)
            step = down * width + right
            for k in range(n_hits):
                i = hits[k]
                pixel = np.uint32(queue.whole[PIXEL, i] + step)
                z, before = order[i], nearest[pixel]
                if z > before + margin:
                    continue
                if not z < before - margin:  # too close to be told apart in float32, or on an edge (NaN)
                    place = pixel % width + 0.5, pixel // width + 0.5
                    if not _is_nearer(mesh, queue.whole[TRIANGLE, i], triangles[pixel], place):
                        continue
                    z = f32(_depth_at(mesh, queue.whole[TRIANGLE, i], place)[1])
                nearest[pixel] = z
                triangles[pixel] = queue.whole[TRIANGLE, i]


@compiled
def _cover(queue: Queue, n: int, right: int, down: int, order: ndarray, hits: ndarray) -> int:
    """Tests one pixel of each box: its order, infinite where it is not covered and NaN where it lies on an edge.

    Lists and counts the boxes where it is covered or on an edge.
    """
    numbers, whole = queue
    for i in range(n):
        u, v = numbers[X, i] + f32(right), numbers[Y, i] + f32(down)
        au, av = numbers[AX, i] - u, numbers[AY, i] - v
        bu, bv = numbers[BX, i] - u, numbers[BY, i] - v
        cu, cv = numbers[CX, i] - u, numbers[CY, i] - v
        # The same for an edge in both directions but for the sign, bit for bit: no centre is between two triangles.
        sa, sb, sc = bu * cv - bv * cu, cu * av - cv * au, au * bv - av * bu
        lowest = sa if sa < sb else sb
        lowest = lowest if lowest < sc else sc
        highest = sa if sa > sb else sb
        highest = highest if highest > sc else sc
        inside = lowest if lowest > -highest else -highest
        z = (sa * numbers[AZ, i] + sb * numbers[BZ, i] + sc * numbers[CZ, i]) / (sa + sb + sc)
        z = z if inside > f32(0) else f32(np.nan)
        z = z if inside >= f32(0) else f32(np.inf)
        z = z if whole[COLUMNS, i] > right else f32(np.inf)
        order[i] = z if whole[ROWS, i] > down else f32(np.inf)
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
