"""Where surfaces share a pixel of a scene, and the colours of such pixels.

A pixel has three samples in each direction, the outer ones shared with its neighbours (`scene_visibility`). Surfaces
are shaded once per pixel, at its centre. At an edge, each sample takes the colour of the neighbouring pixel that shows
the same surface.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int32, UInt8
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled

NOTHING_MM = 1e7  # how deep it is where nothing is seen
NO_EDGE = np.float32(-1e7)
# From this opacity on, nothing is seen of what is behind: it changes a byte by less than one step, even in the darkest
# picture.
HIDES = np.float32(0.9999)
# How much farther than the nearest surface in a pixel another one may be to count in the middle between the two, mm.
FARTHEST_MM = 1000.0


class SceneEdges(NamedTuple):
    """What the samples of each pixel say. Depths in the buffer are from 0 to 1."""

    triangle: Float32[ndarray, "h w"]  # of the head at the pixel's centre, from 1 on; below 1 it is not the head
    kind: Float32[ndarray, "h w"]  # 0 where it is not the head; 1/4, 2/4, 3/4 for the `HEAD_KINDS`
    opaque: Float32[ndarray, "h w"]  # depth in the buffer: of the head, elsewhere slightly behind the farthest sample
    farther: Float32[ndarray, "h w"]  # depth of the farther surface in the buffer
    depths: Float32[ndarray, "h w 2"]  # depth in the buffer of the nearer surface, and of what is at the centre
    middle: Float32[ndarray, "h w"]  # mm, parts nearer from farther surfaces; `NO_EDGE` where there is one alone


@compiled
def find_edges(
    samples: Float32[ndarray, "H W 2"],
    kinds: Int32[ndarray, " t"],
    depth_from_buffer: tuple[float, float, float, float],
    edge_mm: float,
) -> tuple[ndarray, ndarray, ndarray, ndarray, ndarray, ndarray]:
    """The fields of `SceneEdges`.

    Args:
        samples: As `see_scene` returns them.
        kinds: Which of `HEAD_KINDS` paints each triangle of the head.
        depth_from_buffer: x, y, z, w, so that depth in mm is (x d + y) / (z d + w).
        edge_mm: Surfaces of one kind are two where their depths differ by more.
    """
    height, width = samples.shape[0] // 2, samples.shape[1] // 2
    size = height, width
    triangle, kind, middle = np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.float32)
    opaque, farther = np.empty(size, np.float32), np.empty(size, np.float32)
    depths = np.empty((height, width, 2), np.float32)
    for row in range(height):
        for column in range(width):
            own, depth = _seen_at(samples, 2 * row + 1, 2 * column + 1)
            nearest, farthest, differs = depth, depth, False
            for i in range(2 * row, 2 * row + 3):
                for j in range(2 * column, 2 * column + 3):
                    other, there = _seen_at(samples, i, j)
                    nearest, farthest = min(nearest, there), max(farthest, there)
                    differs |= other != own
            here = _in_buffer(depth, depth_from_buffer)
            nearer_here = farther_here = here
            middle[row, column] = NOTHING_MM if differs else NO_EDGE
            if farthest - nearest > edge_mm:
                between = 0.5 * (min(farthest, nearest + FARTHEST_MM) + nearest)
                middle[row, column] = between
                if depth > between:
                    nearer_here = _in_buffer(nearest, depth_from_buffer)
                else:
                    farther_here = _in_buffer(farthest, depth_from_buffer)
            number = samples[2 * row + 1, 2 * column + 1, 0]
            is_head = number > 0
            triangle[row, column] = number
            kind[row, column] = 0.25 * (kinds[int(number) - 1] + 1) if is_head else 0.0
            behind = min(_in_buffer(farthest + edge_mm, depth_from_buffer), 1.0)
            opaque[row, column] = here if is_head else behind
            farther[row, column] = farther_here
            depths[row, column, 0], depths[row, column, 1] = nearer_here, here
    return triangle, kind, opaque, farther, depths, middle


@compiled
def shown_kinds(
    kind: Float32[ndarray, "h w"], over: tuple[Float32[ndarray, "h w 4"], Float32[ndarray, "h w 4"]]
) -> Float32[ndarray, "h w"]:
    """`SceneEdges.kind`, but 0 where transparent objects such as hair hide the head and its colour is not needed.

    Pixels next to an edge take colours from their neighbours, so a pixel counts as hidden only if those around it are.

    Args:
        kind: As in `SceneEdges`.
        over: As in `resolve`.
    """
    height, width = kind.shape
    over_near, over_far = over
    hides = np.zeros((height + 2, width + 2), np.bool_)
    hides[1:-1, 1:-1] = np.minimum(over_near[..., 3], over_far[..., 3]) >= HIDES
    shown = kind.copy()
    for row in range(height):
        for column in range(width):
            if hides[row + 1, column + 1] and hides[row : row + 3, column : column + 3].all():
                shown[row, column] = 0
    return shown


@compiled
def resolve(
    samples: Float32[ndarray, "H W 2"],
    middle: Float32[ndarray, "h w"],
    colours: Float32[ndarray, "h w 4"],
    over: tuple[Float32[ndarray, "h w 4"], Float32[ndarray, "h w 4"]],
    over_labels: UInt8[ndarray, "h w"],
) -> tuple[ndarray, ndarray]:
    """The picture: opaque surfaces, and over them what is transparent.

    Args:
        samples: As `see_scene` returns them.
        middle: As in `SceneEdges`.
        colours: Of the opaque surface at each pixel's centre, and its coverage.
        over: What is transparent in front of the nearer surface of a pixel, and in front of the farther one.
        over_labels: Of what is transparent; 0 for nothing.

    Returns:
        Radiance times coverage, and coverage; and the labels.
    """
    height, width = middle.shape
    over_near, over_far = over
    picture, labels = np.empty((height, width, 4), np.float32), np.empty((height, width), np.uint8)
    nearer, farther = np.empty(4, np.float32), np.empty(4, np.float32)
    # All pixels as if they had no edge: flat arrays, since slices cost more than the sums.
    before, shaded, made = over_near.reshape(-1), colours.reshape(-1), picture.reshape(-1)
    for i in range(0, len(made), 4):
        rest = 1 - before[i + 3]
        for k in range(4):
            made[i + k] = before[i + k] + shaded[i + k] * rest
    for row in range(height):
        for column in range(width):
            label = over_labels[row, column]
            seen = samples[2 * row + 1, 2 * column + 1, 0]
            labels[row, column] = label if label > 0 else np.uint8(abs(min(seen, np.float32(1))))
            if middle[row, column] == NO_EDGE:
                continue
            share = _gather(samples, colours, row, column, middle[row, column], nearer, farther)
            near, far = over_near[row, column], over_far[row, column]
            for k in range(4):
                of_near = near[k] * share + nearer[k] * (1 - near[3])
                picture[row, column, k] = of_near + far[k] * (1 - share) + farther[k] * (1 - far[3])
    return picture, labels


@compiled
def _gather(
    samples: ndarray, colours: ndarray, row: int, column: int, middle: float, nearer: ndarray, farther: ndarray
) -> float:
    """Adds up the samples of a pixel by surface, and returns the share of the nearer one."""
    height, width = colours.shape[:2]
    nearer[:] = 0
    farther[:] = 0
    share = np.float32(0)
    for down in range(-1, 2):
        for right in range(-1, 2):
            weight = np.float32(0.25 / (1 + abs(down)) / (1 + abs(right)))
            what, depth = _seen_at(samples, 2 * row + 1 + down, 2 * column + 1 + right)
            is_near = depth <= middle
            share += weight if is_near else np.float32(0)
            if what == 0:
                continue
            best, best_row, best_column = np.float32(1e9), -1, -1
            for i in range(abs(down) + 1):
                for j in range(abs(right) + 1):
                    y, x = min(max(row + i * down, 0), height - 1), min(max(column + j * right, 0), width - 1)
                    other, there = _seen_at(samples, 2 * y + 1, 2 * x + 1)
                    unlike = abs(there - depth) + np.float32(0 if other == what else 1e5 if other != 0 else 1e8)
                    if unlike < best:
                        best, best_row, best_column = unlike, y, x
            taken = nearer if is_near else farther
            if best_row >= 0:
                for k in range(4):
                    taken[k] += weight * colours[best_row, best_column, k]
    return share


@compiled
def _seen_at(samples: ndarray, i: int, j: int) -> tuple[float, float]:
    """What a sample sees (1 the head, below 0 an object's label, 0 nothing), and its depth in mm."""
    what = samples[i, j, 0]
    return min(what, np.float32(1)), np.float32(NOTHING_MM) if what == 0 else samples[i, j, 1]


@compiled
def _in_buffer(depth: float, depth_from_buffer: tuple[float, float, float, float]) -> float:
    x, y, z, w = depth_from_buffer
    return 1.0 if depth >= NOTHING_MM else (w * depth - y) / (x - z * depth)
