"""Arranges a mesh for the rasterisers: triangles in pairs that share an edge, and neighbours close in memory.

A pair has four corners instead of six, and one bounding box, which saves a third of the work. It is computed once for
each model.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float32, Int32, Int64
from numpy import ndarray

# Of the order along which vertices are numbered: cells of the face's size / 1024.
CURVE_BITS = 10


@final
@dataclass(frozen=True, eq=False)
class TrianglePairs:
    """Triangles 2 i, corners (a, b, c), and 2 i + 1, corners (a, c, d), of each pair."""

    corners: Int32[ndarray, "p 4"]  # a, b, c, d; without a partner d is c, and triangle 2 i + 1 is empty
    source: Int64[ndarray, " t"]  # number in the mesh of each triangle; an empty one has its partner's
    source_corner: Int64[ndarray, "t 3"]  # which corner (0, 1, 2) of the mesh's triangle each corner is

    @property
    def triangles(self) -> Int32[ndarray, "t 3"]:
        """Corners of all triangles, the empty ones among them."""
        return np.ascontiguousarray(self.corners[:, [0, 1, 2, 0, 2, 3]]).reshape(-1, 3)

    def at_corners(self, numbers: Int32[ndarray, "m 3"]) -> Int32[ndarray, "t 3"]:
        """Rearranges values at the corners of the mesh's triangles for the corners of these."""
        return np.ascontiguousarray(np.take_along_axis(numbers[self.source], self.source_corner, axis=1))


def pair_triangles(triangles: Int32[ndarray, "t 3"]) -> TrianglePairs:
    """Pairs neighbours: first those that follow each other (the halves of a quad), then whatever is left."""
    partner = _partners(triangles)
    first = np.flatnonzero(partner < 0)
    lone = np.zeros(len(triangles), dtype=bool)
    lone[first] = True
    first = np.flatnonzero(lone | (np.arange(len(triangles)) < partner))
    second = np.where(lone[first], first, partner[first])
    corners = np.empty((len(first), 4), dtype=np.int32)
    a, b = triangles[first], triangles[second]
    # Turn the first until its corner b is the one that the second has not.
    foreign = ~(a[:, :, None] == b[:, None, :]).any(axis=2)
    at = np.where(lone[first], 1, foreign.argmax(axis=1))
    rows = np.arange(len(first))
    for column, step in enumerate((2, 0, 1)):
        corners[:, column] = a[rows, (at + step) % 3]
    own = ~(b[:, :, None] == a[:, None, :]).any(axis=2)
    corners[:, 3] = np.where(lone[first], corners[:, 2], b[rows, own.argmax(axis=1)])
    source = np.stack([first, second], axis=1).reshape(-1)
    paired = np.ascontiguousarray(corners[:, [0, 1, 2, 0, 2, 3]]).reshape(-1, 1, 3)
    source_corner = (triangles[source][:, :, None] == paired).argmax(axis=1)
    return TrianglePairs(corners, source, source_corner)


def local_order(mean: Float32[ndarray, "v 3"], triangles: Int32[ndarray, "t 3"]) -> Int64[ndarray, " v"]:
    """A numbering of the vertices that puts neighbours near each other: which vertex comes first, second, ....

    That of the mesh itself, unless a space-filling curve does better.
    """
    along_curve = np.argsort(_curve(mean), kind="stable")
    place = np.empty(len(mean), dtype=np.int64)
    place[along_curve] = np.arange(len(mean))
    steps = [np.abs(numbers[triangles[:, 0]] - numbers[triangles[:, 1]]) for numbers in (np.arange(len(mean)), place)]
    own, curve = (np.log2(np.maximum(step, 1)).mean() for step in steps)
    return along_curve if curve < own - 1 else np.arange(len(mean))


def _curve(points: Float32[ndarray, "v 3"]) -> Int64[ndarray, " v"]:
    """Place on a Morton curve."""
    low = points.min(axis=0)
    cells = ((points - low) * ((1 << CURVE_BITS) - 1) / max(float(np.ptp(points, axis=0).max()), 1e-9)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(CURVE_BITS):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


def _partners(triangles: Int32[ndarray, "t 3"]) -> Int64[ndarray, " t"]:
    """For each triangle the one it is paired with, or -1."""
    first, second = _neighbours(triangles)
    partner = np.full(len(triangles), -1, dtype=np.int64)
    halves = (second == first + 1) & (first % 2 == 0)
    partner[first[halves]], partner[second[halves]] = second[halves], first[halves]
    # The rest: an edge is taken where it is the lowest of both its triangles, until none is left. The ranks are mixed,
    # or long rows of triangles would be paired one in a round.
    rank = (np.arange(len(first), dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(1)
    while True:
        free = (partner[first] < 0) & (partner[second] < 0)
        if not free.any():
            return partner
        first, second, rank = first[free], second[free], rank[free]
        best = np.full(len(triangles), np.iinfo(np.uint64).max, dtype=np.uint64)
        np.minimum.at(best, first, rank)
        np.minimum.at(best, second, rank)
        taken = (best[first] == rank) & (best[second] == rank)
        partner[first[taken]], partner[second[taken]] = second[taken], first[taken]


def _neighbours(triangles: Int32[ndarray, "t 3"]) -> tuple[Int64[ndarray, " e"], Int64[ndarray, " e"]]:
    """Pairs of triangles that share two corners and have three each, the lower number first."""
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    key = ends[:, 0].astype(np.int64) << 32 | ends[:, 1]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    first, second = order[same] // 3, order[same + 1] // 3
    first, second = np.minimum(first, second), np.maximum(first, second)
    same_corners = (np.sort(triangles[first], axis=1) == np.sort(triangles[second], axis=1)).all(axis=1)
    usable = whole[first] & whole[second] & ~same_corners
    # Both must run through the shared edge in opposite directions, or the pair has no common winding.
    usable &= _opposed(triangles, first, second)
    return first[usable], second[usable]


def _opposed(triangles: Int32[ndarray, "t 3"], first: Int64[ndarray, " e"], second: Int64[ndarray, " e"]) -> ndarray:
    """Whether an edge of the one is an edge of the other, run through the other way."""
    a, b = triangles[first], triangles[second]
    starts, ends = a[:, :, None], np.roll(a, -1, axis=1)[:, :, None]
    other_starts, other_ends = b[:, None, :], np.roll(b, -1, axis=1)[:, None, :]
    return np.asarray(((starts == other_ends) & (ends == other_starts)).any(axis=(1, 2)))
