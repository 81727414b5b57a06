"""Binds points around the unmodified head to vertices of the built-in model, so that they follow any head.

Close to the skin, a point follows the triangle below it. Farther off, where neighbours in a strand may lie above quite
different places, it follows a smooth mean over the surrounding region. Points below the neck follow the neck's rim.
"""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scripts.hair_assets.proxies import BaseHead, Proxy

# Regions that points are bound to. Ears vary too much for strands that pass over them; eyes and mouth are inside.
CARRIERS = ("skin", "brows", "lips", "scalp", "neck")
# The regions of these that are not the face.
OFF_FACE = ("scalp", "neck")
# Below the hair line, hair before the face is at least this far from the skin, mm. Points deep inside are left out.
CLEARANCE_MM, HAIR_LINE_MM, DEEP_MM, CUT_MM = 1.6, 74.0, 6.0, 0.7
NEAR_FACE_MM = 15.0
# Nearer than the first distance, a point follows the skin alone; beyond the second, the region alone (mm).
NEAR_MM, FAR_MM = 4.0, 16.0
ANCHORS, ANCHORS_OF_POINT = 220, 12
# Lashes stand out forward and upward, so distances along the lid count most.
LASH_METRIC = np.array([3.0, 1.0, 0.5])


@dataclass(frozen=True)
class Binding:
    """How points move with a head: each by the weighted mean of its neighbours' displacements."""

    neighbours: ndarray  # (points, 15) vertices of the model
    weights: ndarray  # (points, 15), sum 1
    feet: ndarray  # nearest point of the skin of the unmodified head, mm
    heights: ndarray  # signed distance from it, mm; negative inside
    outward: ndarray  # unit normal of the skin there
    foot_regions: ndarray  # name of the region where the foot is

    def only(self, points: ndarray) -> "Binding":
        """The binding of some of the points."""
        return Binding(**{name: array[points] for name, array in vars(self).items()})


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
            outward=normals,
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
        outward=binding.outward[root],
        foot_regions=binding.foot_regions[root],
    )


def _strips(proxy: Proxy) -> ndarray:
    edges = np.concatenate([proxy.quads[:, [corner, (corner + 1) % 4]] for corner in range(4)])
    n = len(proxy.points)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def lifted_off_face(proxy: Proxy, binder: Binder) -> Proxy:
    """Takes strands out of the face: some end in cheeks and foreheads, where they would come and go with the head.

    Quads that lie inside altogether, or end deep inside, are left out; what sticks halfway is laid upon the skin. Quads
    that cut through it even so are left out as well.
    """
    binding = binder.bind(proxy.points)
    is_low = _below(binding, CLEARANCE_MM)
    is_inside = is_low & (binding.heights < 0)
    is_deep = is_inside & (binding.heights < -DEEP_MM)
    kept = ~is_inside[proxy.quads].all(axis=1) & ~is_deep[proxy.quads].any(axis=1)
    points = np.where(is_low[:, None], binding.feet + CLEARANCE_MM * binding.outward, proxy.points)
    quads, uv_quads = proxy.quads[kept], proxy.uv_quads[kept]
    # Finding the foot of a distant point takes long, and such a quad cuts through nothing.
    near = np.flatnonzero((np.abs(binding.heights[quads]) < NEAR_FACE_MM).any(axis=1))
    corners = points[quads[near]]
    between = np.concatenate([corners.mean(axis=1)[:, None], (corners + np.roll(corners, 1, axis=1)) / 2], axis=1)
    cuts = np.zeros(len(quads), dtype=bool)
    cuts[near] = _below(binder.bind(between.reshape(-1, 3)), -CUT_MM).reshape(len(near), -1).any(axis=1)
    return replace(proxy, points=points, quads=quads[~cuts], uv_quads=uv_quads[~cuts])


def _below(binding: Binding, height: float) -> ndarray:
    """Finds points over the face that are lower than a height."""
    is_over_face = ~np.isin(binding.foot_regions, OFF_FACE) & (binding.feet[:, 1] < HAIR_LINE_MM)
    return (binding.heights < height) & is_over_face
