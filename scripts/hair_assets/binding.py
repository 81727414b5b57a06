"""Binds points around the unmodified head to vertices of the built-in model, so that they follow any head.

Close to the skin a point follows the triangle below it; farther off, where neighbours in a strand may lie above quite
different places, a smooth mean over the region around. Whatever hangs below the neck follows the neck's rim.
"""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scripts.hair_assets.proxies import BaseHead, Proxy

# Regions that things lie on; ears vary too much for strands that pass over them, eyes and mouth are inside.
CARRIERS = ("skin", "brows", "lips", "scalp", "neck")
# A point this near to the skin follows it alone; one that far the region around, mm.
NEAR_MM, FAR_MM = 4.0, 16.0
ANCHORS, ANCHORS_OF_POINT = 220, 12
# Lashes stand out forward and upward: along the lid counts most.
LASH_METRIC = np.array([3.0, 1.0, 0.5])


@dataclass(frozen=True)
class Binding:
    """How points move with a head: each by the weighted mean of its neighbours' displacements.

    Attributes:
        neighbours: (points, 15) vertices of the model.
        weights: (points, 15), sum 1.
        feet: Nearest point of the skin of the unmodified head, mm.
        heights: Signed distance from it, mm; negative inside.
        foot_regions: Name of the region where the foot is.
    """

    neighbours: ndarray
    weights: ndarray
    feet: ndarray
    heights: ndarray
    foot_regions: ndarray


class Binder:
    """Binds points to one head.

    Args:
        base: The head.
    """

    def __init__(self, base: BaseHead) -> None:
        self._is_carrier = np.isin(base.regions, CARRIERS)
        self._triangles = base.triangles[self._is_carrier]
        self._regions = base.regions[self._is_carrier]
        self._head = base.head
        self._mesh = trimesh.Trimesh(base.head, self._triangles, process=False)
        self._anchors = _spread(base.head, np.unique(self._triangles), ANCHORS)

    def bind(self, points: ndarray, near_mm: float = NEAR_MM, far_mm: float = FAR_MM) -> Binding:
        """Binds points; ``near_mm`` below 0 lets none of them follow a single triangle."""
        feet, _, triangle = trimesh.proximity.closest_point(self._mesh, points)
        corners = self._triangles[triangle]
        shares = trimesh.triangles.points_to_barycentric(self._head[corners], feet)
        normals = self._mesh.face_normals[triangle]
        offsets = points - feet
        heights = np.linalg.norm(offsets, axis=1)
        heights *= np.where((offsets * normals).sum(axis=1) < 0, -1, 1)
        closeness = 1 - np.clip((np.abs(heights) - near_mm) / (far_mm - near_mm), 0, 1)
        closeness = (closeness**2 * (3 - 2 * closeness))[:, None]
        if near_mm < 0:
            closeness = np.zeros_like(closeness)
        anchors, of_anchors = self._around(feet, np.abs(heights))
        return Binding(
            neighbours=np.concatenate([corners, anchors], axis=1),
            weights=np.concatenate([shares * closeness, of_anchors * (1 - closeness)], axis=1),
            feet=feet,
            heights=heights,
            foot_regions=self._regions[triangle],
        )

    def _around(self, feet: ndarray, heights: ndarray) -> tuple[ndarray, ndarray]:
        """The nearest anchors of each foot, weighted so that they come and go smoothly."""
        distance = np.linalg.norm(feet[:, None] - self._head[self._anchors], axis=2)
        order = np.argsort(distance, axis=1, kind="stable")[:, : ANCHORS_OF_POINT + 1]
        nearest = np.take_along_axis(distance, order, axis=1)
        # The weight is 0 where the next anchor begins, whichever it is.
        reach = nearest[:, -1:]
        weights = (1 - (nearest[:, :-1] / reach) ** 2) ** 2
        return self._anchors[order[:, :-1]], weights / weights.sum(axis=1, keepdims=True)


def _spread(points: ndarray, candidates: ndarray, count: int) -> ndarray:
    """Candidates far from each other: each next one is the farthest from those before."""
    chosen = [int(candidates[np.argmax(points[candidates, 1])])]
    distance = np.full(len(candidates), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(points[candidates] - points[chosen[-1]], axis=1))
        chosen.append(int(candidates[np.argmax(distance)]))
    return np.array(chosen)


def bind_lashes(binder: Binder, lashes: Proxy) -> Binding:
    """Binds each point of the lashes to the triangle at the root of its strand, which is its ``feet``.

    A root is the point of the same strip (upper or lower lid, left or right) that is nearest along the lid and close
    to the skin.
    """
    binding = binder.bind(lashes.points, 90.0, 100.0)
    strips = _strips(lashes)
    root = np.empty(len(lashes.points), dtype=int)
    for strip in np.unique(strips):
        members = np.flatnonzero(strips == strip)
        heights = np.abs(binding.heights[members])
        candidates = members[heights <= max(0.4, np.quantile(heights, 0.15))]
        apart = np.abs(lashes.points[members, None] - lashes.points[candidates]) * LASH_METRIC
        root[members] = candidates[apart.sum(axis=2).argmin(axis=1)]
    return replace(
        binding,
        neighbours=binding.neighbours[root],
        weights=binding.weights[root],
        feet=binding.feet[root],
        foot_regions=binding.foot_regions[root],
    )


def _strips(proxy: Proxy) -> ndarray:
    edges = np.concatenate([proxy.quads[:, [corner, (corner + 1) % 4]] for corner in range(4)])
    n = len(proxy.points)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    return connected_components(graph, directed=False)[1]
