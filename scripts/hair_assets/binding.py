"""Binds points around the unmodified head to vertices of the built-in model, so that they follow any head.

Close to the skin, a point follows the triangle below it. Farther away, where neighbours in a strand can be above very
different places, it follows a smooth mean over the surrounding region. Points below the neck follow the neck's rim.
"""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scripts.hair_assets.proxies import BaseHead, Proxy

# Regions to which points are bound. Ears vary too much for the strands over them; eyes and mouth are inside.
CARRIERS = ("skin", "brows", "lips", "scalp", "neck")
# Regions among them that are not the face.
OFF_FACE = ("scalp", "neck")
# Smallest distance of hair from the face, height of the hair line above which it does not apply, depth from which
# points are removed, and depth from which quads cut through the skin.
CLEARANCE_MM, HAIR_LINE_MM, DEEP_MM, CUT_MM = 1.6, 74.0, 6.0, 0.7
NEAR_FACE_MM = 15.0
# Up to the first distance, a point follows the nearest triangle of the skin; from the second on, anchors around it.
NEAR_MM, FAR_MM = 4.0, 16.0
ANCHORS, ANCHORS_OF_POINT = 220, 12
# Distances along the lid have the largest weight, since lashes extend forward and upward.
LASH_METRIC = np.array([3.0, 1.0, 0.5])


@dataclass(frozen=True)
class Binding:
    """A binding of points to a head: each moves by a weighted mean of displacements of vertices."""

    neighbours: ndarray  # (points, 15) vertices of the model
    weights: ndarray  # (points, 15), sum 1
    feet: ndarray  # nearest point of the skin of the unmodified head, mm
    heights: ndarray  # signed distance from it, mm; negative inside
    outward: ndarray  # unit normal of the skin there
    foot_regions: ndarray  # name of the region there

    def only(self, points: ndarray) -> "Binding":
        """Returns the binding of some of the points."""
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
        """Binds points. With a negative ``near_mm``, all of them follow anchors only."""
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
        anchors, of_anchors = self._around(feet)
        return Binding(
            neighbours=np.concatenate([corners, anchors], axis=1),
            weights=np.concatenate([shares * closeness, of_anchors * (1 - closeness)], axis=1),
            feet=feet,
            heights=heights,
            outward=normals,
            foot_regions=self._regions[triangle],
        )

    def _around(self, feet: ndarray) -> tuple[ndarray, ndarray]:
        """Returns the nearest anchors of each foot, with weights that are continuous in its position."""
        distance = np.linalg.norm(feet[:, None] - self._head[self._anchors], axis=2)
        order = np.argsort(distance, axis=1, kind="stable")[:, : ANCHORS_OF_POINT + 1]
        nearest = np.take_along_axis(distance, order, axis=1)
        # The weight is 0 at the distance of the next anchor.
        reach = nearest[:, -1:]
        weights = (1 - (nearest[:, :-1] / reach) ** 2) ** 2
        return self._anchors[order[:, :-1]], weights / weights.sum(axis=1, keepdims=True)


def _spread(points: ndarray, candidates: ndarray, count: int) -> ndarray:
    """Chooses candidates by farthest point sampling."""
    chosen = [int(candidates[np.argmax(points[candidates, 1])])]
    distance = np.full(len(candidates), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(points[candidates] - points[chosen[-1]], axis=1))
        chosen.append(int(candidates[np.argmax(distance)]))
    return np.array(chosen)


def bind_lashes(binder: Binder, lashes: Proxy) -> Binding:
    """Binds each point of the lashes to the triangle at the root of its strand.

    The root is the nearest point along the lid that is close to the skin and in the same strip (upper or lower lid,
    left or right).
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
    """Removes strands from inside the face. Some end in cheeks and foreheads, and would appear on some heads.

    Quads that are completely or deep inside are removed, and other points inside are moved onto the skin. Quads that
    still cut through the skin are removed as well.
    """
    binding = binder.bind(proxy.points)
    is_low = _below(binding, CLEARANCE_MM)
    is_inside = is_low & (binding.heights < 0)
    is_deep = is_inside & (binding.heights < -DEEP_MM)
    kept = ~is_inside[proxy.quads].all(axis=1) & ~is_deep[proxy.quads].any(axis=1)
    points = np.where(is_low[:, None], binding.feet + CLEARANCE_MM * binding.outward, proxy.points)
    quads, uv_quads = proxy.quads[kept], proxy.uv_quads[kept]
    # Distant quads are skipped, since finding their feet takes long and they do not cut through the skin.
    near = np.flatnonzero((np.abs(binding.heights[quads]) < NEAR_FACE_MM).any(axis=1))
    corners = points[quads[near]]
    between = np.concatenate([corners.mean(axis=1)[:, None], (corners + np.roll(corners, 1, axis=1)) / 2], axis=1)
    cuts = np.zeros(len(quads), dtype=bool)
    cuts[near] = _below(binder.bind(between.reshape(-1, 3)), -CUT_MM).reshape(len(near), -1).any(axis=1)
    return replace(proxy, points=points, quads=quads[~cuts], uv_quads=uv_quads[~cuts])


def _below(binding: Binding, height: float) -> ndarray:
    """Whether each point is over the face and below a height."""
    is_over_face = ~np.isin(binding.foot_regions, OFF_FACE) & (binding.feet[:, 1] < HAIR_LINE_MM)
    return (binding.heights < height) & is_over_face
