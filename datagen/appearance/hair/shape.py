"""Varies a modelled hairdo: makes it wider, shorter, combed aside, blown, or tucked under a hat.

All changes are made on the mean head, before the hairdo follows a head. Combing aside widens the gap between the
strands that fall to the left and to the right. Seen from the front, each row of a hairdo has a gap, or a parting where
one begins. Strands beside the gap move outward, those at the side of the head do not move, and those between are
interpolated. All keep their distance from the skin.
"""

from dataclasses import dataclass
from functools import cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, UInt8
from numpy import ndarray

from datagen.appearance.hair.bound_meshes import BoundMesh
from datagen.appearance.hair.styles import Hairdo
from pix2face.models.morphable_model import builtin_model

# A grid over the front of the face: half its width, its lowest and highest row, and the size of a cell, mm.
HALF_WIDTH_MM, LOW_MM, HIGH_MM, CELL_MM = 84.0, -80.0, 120.0, 2.0
IN_FRONT_MM = 20.0  # smallest z of hair that can cover the face
# Largest half width of the free face at several heights.
FREE_AT_MM = np.array([-80.0, 0.0, 25.0, 45.0, 60.0, 74.0, 86.0])
FREE_MM = np.array([72.0, 72.0, 66.0, 58.0, 46.0, 24.0, 0.0])
FULLY_FREE_MM = 50.0
# Gaps are below this height (above is the parting), with their middle within `SIDE_MM`, at least `NARROWEST_MM` wide,
# and end within `FARTHEST_MM` of the middle.
TOP_MM, SIDE_MM, NARROWEST_MM, FARTHEST_MM = 88.0, 70.0, 6.0, 80.0
# Smallest distance of moved strands from the skin, within `STEADY_MM` of the middle, where its depth is accurate.
CLEARANCE_MM, STEADY_MM = 2.0, 66.0
OPAQUE = 0.35  # smallest alpha of hair that hides the face


@final
@dataclass(frozen=True, eq=False)
class Parting:
    """The gap of a hairdo in front of the face, by height."""

    right: Float32[ndarray, " rows"]  # x of the gap's end on the subject's right, mm, for each row
    left: Float32[ndarray, " rows"]  # x of its end on the left


def comb_aside(points: Float32[ndarray, "p 3"], parting: Parting, share: float) -> None:
    """Widens the gap of a hairdo in place; a share of 1 makes it as wide as the face."""
    x, y = points[:, 0], points[:, 1]
    chosen = np.flatnonzero((points[:, 2] > IN_FRONT_MM) & (np.abs(x) < HALF_WIDTH_MM) & (y > LOW_MM) & (y < HIGH_MM))
    if not len(chosen):
        return
    x, y = x[chosen], y[chosen]
    rows = row_heights()
    right, left = np.interp(y, rows, parting.right), np.interp(y, rows, parting.left)
    free = np.interp(y, FREE_AT_MM, FREE_MM)
    share = share * np.clip(free / FULLY_FREE_MM, 0, 1)  # 0 at the hair line
    on_right = x < (right + left) / 2
    ends, side = np.where(on_right, right, left), np.where(on_right, -1, 1)
    new_ends = ends + side * share * np.maximum(free - side * ends, 0)
    # Distance from the side of the head, as a share of that of the gap's end.
    inward = np.clip((HALF_WIDTH_MM - side * x) / (HALF_WIDTH_MM - side * ends), 0, 1)
    moved = side * (HALF_WIDTH_MM - inward * (HALF_WIDTH_MM - side * new_ends))
    # Continuous where hair begins to be in front of the face.
    moved = x + np.clip((points[chosen, 2] - IN_FRONT_MM) / 20, 0, 1) * (moved - x)
    skin = _depth_at(moved, y)
    is_steady = (np.abs(moved) < STEADY_MM) & (y < TOP_MM)
    low = np.where(is_steady, skin + CLEARANCE_MM, -np.inf)
    points[chosen, 2] = np.maximum(points[chosen, 2] + skin - _depth_at(x, y), np.minimum(low, points[chosen, 2] + 25))
    points[chosen, 0] = moved


def find_parting(mesh: BoundMesh, picture: UInt8[ndarray, "h w c"]) -> Parting:
    """Finds the gap of a hairdo, seen from the front. The last channel of its texture is alpha."""
    heights = row_heights()
    gaps = [_gap(row) for row in _seen_from_the_front(mesh, picture)[heights < TOP_MM]]
    known = [place for place, gap in enumerate(gaps) if gap is not None]
    if not known:
        return Parting(*np.zeros((2, len(heights)), dtype=np.float32))
    # A row without a gap gets that of the next row below with one, or the lowest gap.
    below = np.maximum(np.searchsorted(known, np.arange(len(heights)), side="right") - 1, 0)
    ends = np.array([gaps[place] for place in known])[below].T
    ends[:, known[-1] + 1 :] = ends[:, known[-1]].mean()  # the parting above the highest gap
    smooth = [np.convolve(np.pad(end, 6, "edge"), np.full(13, 1 / 13), "valid") for end in ends]
    return Parting(smooth[0].astype(np.float32), smooth[1].astype(np.float32))


def row_heights() -> Float32[ndarray, " rows"]:
    """Returns the heights of the rows, mm, from the lowest."""
    return np.arange(LOW_MM, HIGH_MM + 1e-6, CELL_MM, dtype=np.float32)


def _seen_from_the_front(mesh: BoundMesh, picture: UInt8[ndarray, "h w c"]) -> UInt8[ndarray, "rows columns"]:
    """Returns a mask of the cells that opaque triangles cover, lowest row first."""
    rows, columns = len(row_heights()), int(2 * HALF_WIDTH_MM / CELL_MM) + 1
    covered = np.zeros((rows, columns), np.uint8)
    corners = mesh.mean[mesh.point_of_vertex[mesh.triangles]]
    uv = mesh.uv[mesh.triangles].mean(axis=1)
    height, width = picture.shape[:2]
    texel = picture[
        np.clip((uv[:, 1] * height).astype(int), 0, height - 1), np.clip((uv[:, 0] * width).astype(int), 0, width - 1)
    ]
    chosen = (corners[..., 2].max(axis=1) > IN_FRONT_MM) & (texel[:, -1] > 255 * OPAQUE)
    cells = (corners[chosen][..., :2] - [-HALF_WIDTH_MM, LOW_MM]) / CELL_MM
    for triangle in np.rint(cells).astype(np.int32):
        cv2.fillConvexPoly(covered, triangle, 1)
    return covered


def _gap(row: UInt8[ndarray, " columns"]) -> tuple[float, float] | None:
    """Returns the ends (x, mm) of the widest gap of a row; None if there is none."""
    ends = np.flatnonzero(np.diff(np.concatenate([[1], row, [1]]).astype(int)))
    starts, stops = ends[::2], ends[1::2]
    if not len(starts):
        return None
    widest = int(np.argmax(stops - starts))
    right, left = (float(ends[widest] * CELL_MM - HALF_WIDTH_MM) for ends in (starts, stops))
    if left - right < NARROWEST_MM or abs(left + right) > 2 * SIDE_MM:
        return None
    return max(right, -FARTHEST_MM), min(left, FARTHEST_MM)


def _depth_at(x: Float[ndarray, " n"], y: Float[ndarray, " n"]) -> Float32[ndarray, " n"]:
    """Returns the depth (z) of the skin of the mean head."""
    depth = _depths()
    column = np.clip((x + HALF_WIDTH_MM) / CELL_MM, 0, depth.shape[1] - 1).astype(np.float32)
    row = np.clip((y - LOW_MM) / CELL_MM, 0, depth.shape[0] - 1).astype(np.float32)
    return cv2.remap(depth, column[None], row[None], cv2.INTER_LINEAR)[0]


@cache
def _depths() -> Float32[ndarray, "rows columns"]:
    """Returns the smoothed depth (z) of the mean head's front at the cells."""
    model = builtin_model()
    regions = ("skin", "brows", "lips", "eyes", "iris", "pupil", "scalp", "neck")
    front = model.mean[model.vertices_of(*regions)].astype(np.float64)
    front = front[front[:, 2] > -20]
    x, y = np.meshgrid(np.arange(-HALF_WIDTH_MM, HALF_WIDTH_MM + 1e-6, CELL_MM), row_heights())
    from scipy.interpolate import LinearNDInterpolator  # here, since it takes a third of a second to import

    interpolate = LinearNDInterpolator(front[:, :2], front[:, 2])
    depth = np.nan_to_num(interpolate(x, y), nan=-20.0).astype(np.float32)
    return cv2.GaussianBlur(depth, (0, 0), 1.5)


EARS_MM = 0.0  # height of the middle of the ears
# Height of the strip of hair above the rim of a hat that is kept, and distance of hair from the skin at the rim.
STRIP_MM, AT_RIM_MM = 12.0, 3.0


@final
@dataclass(frozen=True)
class CrownPlane:
    """The plane above which a hat hides hair."""

    point: tuple[float, float, float]  # on the rim of the hat, mm, on the mean head
    normal: tuple[float, float, float]  # unit, towards the top of the hat


def shaped(mesh: BoundMesh, parting: Parting, hairdo: Hairdo, crown: CrownPlane | None) -> Float32[ndarray, "p 3"]:
    """Returns the points of a mesh on the mean head, with the variations of a hairdo."""
    points = mesh.mean - mesh.feet
    height = np.linalg.norm(points, axis=1)
    # Hair that hangs far from the head keeps its shape.
    points *= (1 + (hairdo.volume - 1) * np.clip((140 - height) / 80, 0, 1))[:, None]
    if crown is not None:
        points *= _tucked(mesh, crown, height)[:, None]
    points += mesh.feet
    points[:, 1] = np.where(points[:, 1] < EARS_MM, EARS_MM + (points[:, 1] - EARS_MM) * hairdo.length, points[:, 1])
    if hairdo.aside > 0:
        comb_aside(points, parting, hairdo.aside)
    points[:, 0] += hairdo.sway_mm * np.minimum(height / 100, 1.5) ** 1.5
    return points


def uncovered(mesh: BoundMesh, points: Float32[ndarray, "p 3"], crown: CrownPlane | None) -> Int32[ndarray, "t 3"]:
    """Returns the triangles that a hat does not hide: those below it both as modelled and as worn (`points`)."""
    if crown is None:
        return mesh.triangles
    is_seen: Bool[ndarray, " v"] = (np.maximum(_above(mesh.mean, crown), _above(points, crown)) < STRIP_MM)[
        mesh.point_of_vertex
    ]
    return np.ascontiguousarray(mesh.triangles[is_seen[mesh.triangles].all(axis=1)])


def _above(points: Float32[ndarray, "p 3"], crown: CrownPlane) -> Float32[ndarray, " p"]:
    return (points - np.array(crown.point, np.float32)) @ np.array(crown.normal, np.float32)


def _tucked(mesh: BoundMesh, crown: CrownPlane, height: Float32[ndarray, " p"]) -> Float32[ndarray, " p"]:
    """Returns the factor on the distance from the skin under a hat: small at the rim, 1 far below it."""
    most = AT_RIM_MM + 0.8 * np.maximum(-_above(mesh.mean, crown), 0)
    return np.minimum(1, most / np.maximum(height, 1e-3))
