"""Finds the places of a head and the smooth surface of its skull, for fitting accessories."""

from dataclasses import dataclass
from functools import lru_cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int32
from numpy import ndarray
from scipy.spatial import cKDTree

from datagen.appearance.scene import PosedHead
from datagen.random_streams import Triple
from pix2face.models.morphable_model import MorphableModel

# The outer surface of the head, without the ears.
OUTER_REGIONS = ("skin", "brows", "lips", "scalp", "neck")


@final
@dataclass(frozen=True, eq=False)
class Anchors:
    """Points on the surface of a model, as barycentric coordinates."""

    corners: Int32[ndarray, "n 3"]  # vertices of the triangle of each point
    weights: Float32[ndarray, "n 3"]  # weights of these vertices; rows sum to 1

    def at(self, values: Float32[ndarray, "v 3"]) -> Float32[ndarray, "n 3"]:
        """Interpolates values of the vertices, such as positions or normals, at the points."""
        w, found = self.weights, values[self.corners]
        return w[:, :1] * found[:, 0] + w[:, 1:2] * found[:, 1] + w[:, 2:] * found[:, 2]


def anchors_outward(model: MorphableModel, centre: Float[ndarray, "3"], directions: Float[ndarray, "n 3"]) -> Anchors:
    """Returns the points where rays from inside the mean head leave it: the outermost intersections.

    A ray without an intersection gets a point in the triangle whose centroid is nearest to it.
    """
    triangles = model.triangles[model.triangles_of(*OUTER_REGIONS)]
    corners = model.mean[triangles].astype(np.float64) - centre
    middle = corners.mean(axis=1)
    tree = cKDTree(middle / np.linalg.norm(middle, axis=1, keepdims=True))
    rays = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    near = tree.query(rays, k=32)[1]
    # direction * t = sum of weights * corner: a 3 x 3 system for each ray and candidate.
    inverse = np.linalg.pinv(np.swapaxes(corners, 1, 2))[near]
    scaled = np.einsum("nkij,nj->nki", inverse, rays)
    total = scaled.sum(axis=2)
    weights = scaled / np.where(np.abs(total) < 1e-12, 1e-12, total)[..., None]
    distance = np.where((weights.min(axis=2) > -1e-6) & (total > 0), 1 / np.maximum(total, 1e-12), 0)
    best = distance.argmax(axis=1)  # 0, the nearest triangle, if there is no intersection
    rows = np.arange(len(rays))
    found = np.clip(weights[rows, best], 0, 1)
    found /= np.maximum(found.sum(axis=1, keepdims=True), 1e-9)
    return Anchors(triangles[near[rows, best]].astype(np.int32), found.astype(np.float32))


@lru_cache(maxsize=8)
def grid_outward(
    model: MorphableModel, centre: Triple, rise_deg: tuple[float, float], half_width_deg: float, shape: tuple[int, int]
) -> Anchors:
    """Returns anchors on a grid of rays around the front of the head, row by row.

    Args:
        model: The model.
        centre: Origin of the rays in mm.
        rise_deg: Elevation of the first and of the last row.
        half_width_deg: Azimuth of the last column, to the subject's left.
        shape: Number of rows and columns.
    """
    rise = np.deg2rad(np.linspace(*rise_deg, shape[0]))[:, None]
    around = np.deg2rad(np.linspace(-half_width_deg, half_width_deg, shape[1]))[None]
    return anchors_outward(model, np.array(centre), direction(rise, around).reshape(-1, 3))


@lru_cache(maxsize=64)
def nearest_vertices(
    model: MorphableModel, places: tuple[Triple, ...], regions: tuple[str, ...] = OUTER_REGIONS
) -> Int32[ndarray, " n"]:
    """Returns the vertex of some regions that is nearest to each place on the mean head (mm)."""
    candidates = model.vertices_of(*regions)
    return candidates[cKDTree(model.mean[candidates]).query(np.array(places))[1]]


def nearest_on_side(
    model: MorphableModel, places: tuple[Triple, ...], side: int, regions: tuple[str, ...] = OUTER_REGIONS
) -> Int32[ndarray, " n"]:
    """Calls `nearest_vertices` for places on the left (side 1), or for their mirror images on the right (side -1)."""
    return nearest_vertices(model, tuple((side * x, y, z) for x, y, z in places), regions)


def bilinear(values: Float32[ndarray, "r c *v"], rows: Float[ndarray, "*n"], columns: Float[ndarray, "*n"]) -> ndarray:
    """Interpolates the values of a grid bilinearly at fractional rows and columns within it."""
    row = np.clip(rows.astype(np.intp), 0, values.shape[0] - 2)
    column = np.clip(columns.astype(np.intp), 0, values.shape[1] - 2)
    extra = (1,) * (values.ndim - 2)
    down, along = (rows - row).reshape(*rows.shape, *extra), (columns - column).reshape(*rows.shape, *extra)
    upper = (1 - along) * values[row, column] + along * values[row, column + 1]
    lower = (1 - along) * values[row + 1, column] + along * values[row + 1, column + 1]
    return np.asarray((1 - down) * upper + down * lower, dtype=np.float32)


@lru_cache(maxsize=4)
def neck_rim(model: MorphableModel) -> tuple[Int32[ndarray, " n"], Int32[ndarray, " n"]]:
    """Finds the border of the neck, from the back over the subject's left side and the front.

    Returns:
        Vertices around the border, with the first repeated at the end, and a neighbour of each that is not on it.
    """
    edges = np.concatenate([model.triangles[:, [0, 1]], model.triangles[:, [1, 2]], model.triangles[:, [2, 0]]])
    keys = np.sort(edges, axis=1) @ np.array([len(model.mean), 1], dtype=np.int64)
    unique, count = np.unique(keys, return_counts=True)
    border = edges[np.isin(keys, unique[count == 1])]
    after = dict(border.tolist())
    on_neck = set(model.vertices_of("neck").tolist())
    start = min((vertex for vertex in after if vertex in on_neck), key=lambda vertex: model.mean[vertex, 1])
    loop = [start]
    while (following := after[loop[-1]]) != start:
        loop.append(following)
    back = int(model.mean[loop, 2].argmin())
    loop = loop[back:] + loop[:back]
    if model.mean[loop[len(loop) // 4], 0] < 0:
        loop = loop[:1] + loop[:0:-1]
    neighbours: dict[int, list[int]] = {vertex: [] for vertex in loop}
    for first, second in edges.tolist():
        if first in neighbours and second not in neighbours:
            neighbours[first].append(second)
    inside = [_straightest(model.mean, neighbours, loop, place) for place in range(len(loop))]
    return np.array(loop + loop[:1], dtype=np.int32), np.array(inside + inside[:1], dtype=np.int32)


def _straightest(mean: Float32[ndarray, "v 3"], neighbours: dict[int, list[int]], loop: list[int], place: int) -> int:
    """Returns the neighbour in the direction that is most perpendicular to the border."""
    here = mean[loop[place]]
    along = mean[loop[(place + 1) % len(loop)]] - mean[loop[place - 1]]
    found = neighbours[loop[place]]
    slant = [abs(float((mean[one] - here) @ along)) / float(np.linalg.norm(mean[one] - here)) for one in found]
    return found[int(np.argmin(slant))]


CENTRE = np.array([0.0, 40.0, 0.0])
_ROWS, _COLUMNS = 31, 49
_LOWEST_DEG = -75.0


def direction(rise: Float[ndarray, "*#n"], around: Float[ndarray, "*#n"]) -> Float[ndarray, "*_ 3"]:
    """Returns unit vectors at elevations `rise` and azimuths `around` (0 is the front, then left), in radians."""
    rise, around = np.broadcast_arrays(rise, around)
    level = np.cos(rise)
    return np.stack([level * np.sin(around), np.sin(rise), level * np.cos(around)], axis=-1)


@final
@dataclass(frozen=True, eq=False)
class Skull:
    """The surface of one head in spherical coordinates."""

    centre: Float32[ndarray, "3"]  # centre of the skull, mm, model frame
    # distance of the skin, mm; rows from the crown down, columns around from the back over the right side
    radii: Float32[ndarray, "r c"]

    def radius(self, rise: Float[ndarray, "*#n"], around: Float[ndarray, "*#n"]) -> Float32[ndarray, "*_"]:
        """Returns the distance of the skin from the centre, mm; arguments are those of `direction`."""
        top, low = np.pi / 2, np.deg2rad(_LOWEST_DEG)
        rows = np.clip((top - rise) / (top - low), 0, 1) * (_ROWS - 1)
        columns = np.mod(around / (2 * np.pi) + 0.5, 1.0) * (_COLUMNS - 1)
        return bilinear(self.radii, *np.broadcast_arrays(rows, columns))

    def at(
        self, rise: Float[ndarray, "*#n"], around: Float[ndarray, "*#n"], above_mm: Float[ndarray, "*#n"] | float
    ) -> Float32[ndarray, "*_ 3"]:
        """Returns points `above_mm` above the skin, mm, model frame."""
        rise, around, above_mm = np.broadcast_arrays(rise, around, above_mm)
        distance = self.radius(rise, around) + above_mm
        return np.asarray(self.centre + distance[..., None] * direction(rise, around), dtype=np.float32)


def fit_skull(head: PosedHead, *, with_expression: bool = False) -> Skull:
    """Measures the skull of a head, without its expression (for rigid hats) or with it (for scarves)."""
    place = head.vertices if with_expression else head.neutral
    points = _skull_anchors(head.model).at(place)
    centre = CENTRE + (points - _skull_anchors(head.model).at(head.model.mean))[: _COLUMNS * 15].mean(axis=0)
    ways = direction(*_grid()).reshape(-1, 3)
    radii = ((points - centre) * ways).sum(axis=1).reshape(_ROWS, _COLUMNS).astype(np.float32)
    wrapped = np.concatenate([radii[:, -4:-1], radii, radii[:, 1:4]], axis=1)
    smooth = cv2.GaussianBlur(wrapped, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE)
    return Skull(centre.astype(np.float32), np.maximum(smooth, 0.5 * (smooth + wrapped))[:, 3:-3])


def _grid() -> tuple[Float[ndarray, "r c"], Float[ndarray, "r c"]]:
    rise = np.linspace(np.pi / 2, np.deg2rad(_LOWEST_DEG), _ROWS)
    return np.meshgrid(rise, np.linspace(-np.pi, np.pi, _COLUMNS), indexing="ij")


@lru_cache(maxsize=4)
def _skull_anchors(model: MorphableModel) -> Anchors:
    return anchors_outward(model, CENTRE, direction(*_grid()).reshape(-1, 3))
