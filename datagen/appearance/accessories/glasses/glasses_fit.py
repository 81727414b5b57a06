"""Where glasses sit on a head: before the eyes, on the nose, past the temples, on the ears."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32, Int64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from datagen.appearance.accessories.glasses.glasses_choice import Glasses
from datagen.appearance.accessories.head_fit import nearest_vertices, triangles_of
from datagen.appearance.scene import PosedHead
from pix2face.models.morphable_model import MorphableModel

FRONT_REGIONS = ("skin", "brows", "eyes", "iris", "pupil")
_CLEAR_MM = 1.5  # between frame and skin
_CELL_MM, _CELLS, _LOW = 4.0, 54, np.array([-108.0, -76.0])  # cells over the front of the face
_TEMPLE_MM = 2.2  # from the middle of a temple to the skin
_LENS_BEFORE_EYE_MM = 11.0

# On the mean head: bridge of the nose, left pupil, groove above the left ear, behind that ear high and low.
_PLACES = np.array([[0, 20, 104], [33, 27, 94], [76.5, 37, 4], [75, 26, -19], [71.5, 12, -18]], dtype=np.float64)


@final
@dataclass(frozen=True, eq=False)
class GlassesFit:
    """Where the parts of a pair are, model frame, mm.

    Attributes:
        rotation: Model from front frame.
        place: Of the front frame's origin.
        temples: Path of each, from hinge to behind the ear; 1 the left, -1 the right.
        strap: Around the head, from the left end of the front to the right one.
    """

    rotation: Float64[ndarray, "3 3"]
    place: Float64[ndarray, "3"]
    temples: Mapping[int, Float64[ndarray, "_ 3"]]
    strap: Float64[ndarray, "_ 3"]


def fit_glasses(worn: Glasses, head: PosedHead, front: Float[ndarray, "n 3"]) -> GlassesFit:
    """Puts glasses on a head.

    Args:
        worn: How they are worn.
        head: Whose expression counts too: raised cheeks and brows push the front forward.
        front: Points of the front in its own frame, which shall not enter the face.
    """
    marks = {side: head.neutral[_marks(head.model)[side]].astype(np.float64) for side in (1, -1)}
    bridge = marks[1][0] * [0, 1, 1] + [0.5 * (marks[1][1][0] + marks[-1][1][0]), 0, 0]
    eyes = 0.5 * (marks[1][1] + marks[-1][1])
    rotation = Rotation.from_euler("xz", [worn.tilt_deg - 22 * worn.lift, worn.skew_deg], degrees=True).as_matrix()
    y = 0.5 * (eyes[1] + bridge[1]) - 1.0 - worn.slip_mm + worn.lift * (68.0 + 0.3 * worn.height_mm)
    place = np.array([bridge[0], y, eyes[2] + _LENS_BEFORE_EYE_MM if worn.lift == 0 else -100.0])
    points = front[::2] @ rotation.T + place
    clear = _CLEAR_MM + (7.0 if worn.lift > 0 else 0.0)  # hair
    place[2] += max(0.0, clear - float(_in_front(head, points).min()))
    hinge = np.array([0.5 * worn.bridge_mm + worn.width_mm + 1.0, 0.22 * worn.height_mm, 0.0])
    hinge[2] = -0.0016 * hinge[0] ** 2
    hinges = {side: rotation @ (hinge * [side, 1, 1]) + place for side in (1, -1)}
    temples = {side: _temple_path(head, hinges[side], marks[side], side) for side in (1, -1)}
    return GlassesFit(rotation, place, temples, _strap_path(head, hinges))


def _temple_path(
    head: PosedHead, hinge: Float64[ndarray, "3"], marks: Float64[ndarray, "5 3"], side: int
) -> Float64[ndarray, "n 3"]:
    """Straight from hinge to ear, but beside the head, then down behind the ear."""
    over_ear = marks[2] + [side * 1.8, 2.8, 0]
    behind = marks[3] + [side * 2.6, 0, -0.5]
    below = marks[4] + [side * 2.6, 0, -1.0]
    share = np.linspace(0, 1, 10)[:, None]
    line = hinge + share * (over_ear - hinge)
    corner = over_ear + 0.45 * (behind - over_ear) + [side * 1.0, 3.5, -1.5]
    path = np.concatenate([hinge[None], line[1:], corner[None], behind[None], below[None]])
    beside = _half_width(head, side, path[:, 1:]) + _TEMPLE_MM
    path[:, 0] = side * np.maximum(side * path[:, 0], beside)
    return _pushed_out(head, path, side)


def _pushed_out(head: PosedHead, path: Float64[ndarray, "n 3"], side: int) -> Float64[ndarray, "n 3"]:
    """Moves what is in the skin out of it; twice, since another vertex may be nearest afterwards."""
    chosen = _side_vertices(head.model)[side]
    skin, normals = head.neutral[chosen].astype(np.float64), head.normals[chosen]
    for _ in range(2):
        nearest = (np.square(skin).sum(axis=1) - 2 * path @ skin.T).argmin(axis=1)
        outside = ((path - skin[nearest]) * normals[nearest]).sum(axis=1)
        path = path + np.clip(_TEMPLE_MM - outside, 0, 6)[:, None] * normals[nearest]
    return path


def _strap_path(head: PosedHead, hinges: Mapping[int, Float64[ndarray, "3"]]) -> Float64[ndarray, "n 3"]:
    """Around the back of the head in a plane through both ends of the front."""
    y = hinges[1][1]
    around = head.neutral[_scalp(head.model)]
    near = around[np.abs(around[:, 1] - y - 10) < 14]
    depth, middle = float(near[:, 2].min()), float(near[:, 2].mean())
    half = float(np.abs(near[:, 0]).max())
    angle = np.linspace(0.12, 1, 12) * np.pi / 2
    left = np.stack(
        [(half + 7) * np.cos(angle), y + 14 * np.sin(angle), (depth - 5 - middle) * np.sin(angle) + middle], axis=1
    )
    return np.concatenate([hinges[1][None], left, left[-2::-1] * [-1, 1, 1], hinges[-1][None]])


def _in_front(head: PosedHead, points: Float64[ndarray, "n 3"]) -> Float64[ndarray, " n"]:
    """How far points are before the face, mm along z, whatever its expression."""
    chosen = _front_vertices(head.model)
    neutral, face = head.neutral.take(chosen, axis=0), head.vertices.take(chosen, axis=0)
    face = np.where(neutral[:, 2:] > face[:, 2:], neutral, face)
    normals = head.normals.take(chosen, axis=0)
    nearest = _nearest_in_plane(face, points)
    aside = points[:, None, :2] - face[nearest, :2]
    normal = normals[nearest]
    slope = (normal[..., :2] * aside).sum(axis=-1) / np.maximum(normal[..., 2], 0.3)
    before = points[:, None, 2] - (face[nearest, 2] - np.clip(slope, -4, 4))
    return np.where(nearest >= 0, before, 1e3).min(axis=1)


def _nearest_in_plane(face: Float32[ndarray, "v 3"], points: Float64[ndarray, "n 3"]) -> Int32[ndarray, "n 2"]:
    """The two nearest vertices in x and y, among one (the foremost) in each cell around; no tree pays for so few."""
    order = np.argsort(face[:, 2])
    cells = np.clip(((face[order, :2] - _LOW) / _CELL_MM).astype(np.intp), 0, _CELLS - 1) + 1
    field = np.full((_CELLS + 2, _CELLS + 2), -1, dtype=np.int32)
    field[cells[:, 0], cells[:, 1]] = order
    at = np.clip(((points[:, :2] - _LOW) / _CELL_MM).astype(np.intp), 0, _CELLS - 1)
    around = np.stack([field[at[:, 0] + i, at[:, 1] + j] for i in range(3) for j in range(3)], axis=1)
    aside = face[around, :2] - points[:, None, :2].astype(np.float32)
    distance = np.where(around >= 0, np.square(aside[..., 0]) + np.square(aside[..., 1]), 1e6)
    first = np.argpartition(distance, 1, axis=1)[:, :2]
    return np.take_along_axis(around, first, axis=1)


def _half_width(head: PosedHead, side: int, places: Float64[ndarray, "n 2"]) -> Float64[ndarray, " n"]:
    """How far one side of the head reaches out near places (y, z), mm."""
    chosen = _side_vertices(head.model)[side]
    beside = head.neutral[chosen]
    aside = np.abs(beside[None, :, 1:] - places[:, None].astype(np.float32))
    near = (aside[..., 0] < 5.0) & (aside[..., 1] < 5.0)
    return np.where(near, side * beside[:, 0].astype(np.float64), -1e3).max(axis=1)


@lru_cache(maxsize=4)
def _marks(model: MorphableModel) -> Mapping[int, Int32[ndarray, "5"]]:
    regions = ("skin", "scalp", "pupil", "neck")
    return {side: nearest_vertices(model, _PLACES * [side, 1, 1], regions) for side in (1, -1)}


@lru_cache(maxsize=4)
def _front_vertices(model: MorphableModel) -> Int64[ndarray, " n"]:
    found = np.unique(model.triangles[triangles_of(model, (*FRONT_REGIONS, "scalp"))])
    place = model.mean[found]
    chosen = (np.abs(place[:, 0]) < 76) & (place[:, 1] > -58) & (place[:, 2] > 25)
    return found[chosen].astype(np.int64)


@lru_cache(maxsize=4)
def _side_vertices(model: MorphableModel) -> Mapping[int, Int32[ndarray, " n"]]:
    found = np.unique(model.triangles[triangles_of(model, ("skin", "scalp", "neck"))])
    place = model.mean[found]
    aside = (place[:, 1] > -15) & (place[:, 1] < 115) & (place[:, 2] > -45) & (np.abs(place[:, 0]) > 45)
    return {side: found[aside & (side * place[:, 0] > 0)].astype(np.int32) for side in (1, -1)}


@lru_cache(maxsize=4)
def _scalp(model: MorphableModel) -> Int32[ndarray, " n"]:
    return np.unique(model.triangles[triangles_of(model, ("scalp",))]).astype(np.int32)
