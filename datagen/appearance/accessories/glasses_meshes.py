"""Meshes of glasses with clear, tinted or mirrored lenses, and of goggles, and their place on a head."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from datagen.appearance.accessories.glasses import Glasses
from datagen.appearance.accessories.head_fit import nearest_on_side
from datagen.appearance.accessories.materials import smooth
from datagen.appearance.scene import Material, PosedHead, SceneMesh
from datagen.appearance.solids import Solid, joined, scene_mesh, sheet, solid, tube
from pix2face.models.morphable_model import MorphableModel

OUTLINE = 28  # points around a lens
_CELL_MM, _CELLS, _LOW = 4.0, 54, np.array([-108.0, -76.0])  # a grid over the front of the face
_TEMPLE_MM = 2.2  # distance from the axis of a temple to the skin

# Places on the mean head: bridge of the nose, left pupil, groove above the left ear, behind that ear high and low.
_PLACES = ((0.0, 20.0, 104.0), (33, 27, 94), (76.5, 37, 4), (75, 26, -19), (71.5, 12, -18))


def glasses_meshes(glasses: Glasses, head: PosedHead) -> list[SceneMesh]:
    """Makes the meshes of the frame and the lenses."""
    local = [_rim_and_lens(glasses, side) for side in (1, -1)]
    frame = [rim for rim, _ in local if rim is not None]
    front, lenses = joined([*frame, _bridge(glasses)]), joined([lens for _, lens in local])
    regions = ("skin", "scalp", "pupil", "neck")
    marks = {
        side: head.neutral[nearest_on_side(head.model, _PLACES, side, regions)].astype(np.float64) for side in (1, -1)
    }
    rotation, place = _placed(glasses, head, marks, np.concatenate([lenses.vertices, front.vertices]))
    front, lenses = (made.placed(rotation, place) for made in (front, lenses))
    sides = _sides(glasses, head, marks, rotation, place)
    material = smooth(glasses.colour, 0.28 if glasses.is_metal else 0.35, 0.5 if glasses.is_metal else 0.05)
    glass = Material(
        kind="glass",
        colour=glasses.lens_colour,
        alpha=glasses.lens_alpha,
        roughness=0.08,
        numbers=(glasses.mirror, glasses.gradient, 0.0, 0.0),
        is_blended=True,
    )
    return [
        scene_mesh(f"glasses/{glasses.shape}", "glasses", joined([front, *sides]), material),
        scene_mesh("glasses/lenses", "glasses", lenses, glass, casts_shadow=glasses.lens_alpha > 0.5),
    ]


def _curved(points: np.ndarray) -> np.ndarray:
    """Bends a flat front around the face, backward with the distance from the nose."""
    bent = points.copy()
    bent[..., 2] -= 0.0016 * bent[..., 0] ** 2
    return bent


def _rim_and_lens(glasses: Glasses, side: int) -> tuple[Solid | None, Solid]:
    """Makes rim and lens on one side (1 is left), with x left, y up, z forward, and the origin between the lenses."""
    flat = outline(glasses.shape, OUTLINE) * [glasses.width_mm / 2, glasses.height_mm / 2]
    middle = 0.5 * (glasses.bridge_mm + glasses.width_mm)
    edge = np.stack([side * (flat[:, 0] + middle), flat[:, 1], np.zeros(OUTLINE)], axis=1)
    centre = edge.mean(axis=0)
    rings = np.stack([centre + part * (edge - centre) for part in (0.02, 0.5, 1.0)])
    rings[..., 2] += (1 - np.array([0.0, 0.25, 1.0]))[:, None] * 1.2
    rings = _curved(np.concatenate([rings, rings[:, :1]], axis=1))
    lens = sheet(rings, is_closed=True)
    span = (rings[..., 1] - rings[..., 1].min()) / np.ptp(rings[..., 1])
    uv = np.stack([0.5 + 0.0 * span, 1 - span], axis=-1).reshape(-1, 2)
    lens = solid(lens.vertices, lens.triangles, uv, lens.normals)
    if glasses.rim == "none":
        return None, lens
    path = _curved(np.concatenate([edge, edge[:2]]))
    if glasses.rim == "half":
        path = path[: OUTLINE // 2 + 1]
    half = glasses.thickness_mm
    depth = 14.0 if glasses.rim == "goggles" else min(half, 1.2) + 0.4
    return tube(path, (half, depth / 2), (0, 0, 1), 6, squareness=0.5), lens


def _bridge(glasses: Glasses) -> Solid:
    """Makes the bridge between the lenses."""
    half = 0.5 * glasses.bridge_mm + 0.5
    x = np.linspace(-half, half, 7)
    rise = 0.16 * glasses.height_mm + 1.5 * (1 - (x / half) ** 2)
    path = np.stack([x, rise, 1.5 * (1 - (x / half) ** 2)], axis=1)
    thick = max(glasses.thickness_mm, 0.7)
    parts = [tube(path, (thick, thick), (0, 0, 1), 6)]
    if glasses.shape == "aviator":
        top = path * [1.5, 0, 1] + [0, 0.42 * glasses.height_mm, 0]
        parts.append(tube(top, 0.8, (0, 0, 1), 5))
    return joined(parts)


def _temple(glasses: Glasses, path: Float64[ndarray, "n 3"]) -> Solid:
    """Makes a temple from the hinge to the ear and down behind it."""
    thick = max(0.7, min(glasses.thickness_mm, 1.6))
    tall = thick if glasses.is_metal else max(1.5, 1.6 * glasses.thickness_mm)
    return tube(path, (min(thick, 1.2), tall), (0, 0.6, -0.8), 6, squareness=0.4)


def _placed(
    glasses: Glasses, head: PosedHead, marks: Mapping[int, Float64[ndarray, "5 3"]], front: Float32[ndarray, "n 3"]
) -> tuple[Float64[ndarray, "3 3"], Float64[ndarray, "3"]]:
    """Returns rotation and origin of the front, with the points `front`. Raised cheeks and brows push it forward."""
    bridge = marks[1][0] * [0, 1, 1] + [0.5 * (marks[1][1][0] + marks[-1][1][0]), 0, 0]
    eyes = 0.5 * (marks[1][1] + marks[-1][1])
    angles_deg = [glasses.tilt_deg - 22 * glasses.lift, glasses.skew_deg]
    rotation = Rotation.from_euler("xz", angles_deg, degrees=True).as_matrix()
    y = 0.5 * (eyes[1] + bridge[1]) - 1.0 - glasses.slip_mm + glasses.lift * (68.0 + 0.3 * glasses.height_mm)
    place = np.array([bridge[0], y, eyes[2] + 11.0 if glasses.lift == 0 else -100.0])
    points = front[::2] @ rotation.T + place
    clear_mm = 1.5 if glasses.lift == 0 else 8.5  # between the frame and the skin, or over hair
    place[2] += max(0.0, clear_mm - float(_in_front(head, points).min()))
    return rotation, place


def _sides(
    glasses: Glasses,
    head: PosedHead,
    marks: Mapping[int, Float64[ndarray, "5 3"]],
    rotation: Float64[ndarray, "3 3"],
    place: Float64[ndarray, "3"],
) -> list[Solid]:
    """Makes two temples, or the strap of goggles."""
    hinge = np.array([0.5 * glasses.bridge_mm + glasses.width_mm + 1.0, 0.22 * glasses.height_mm, 0.0])
    hinge[2] = -0.0016 * hinge[0] ** 2
    hinges = {side: rotation @ (hinge * [side, 1, 1]) + place for side in (1, -1)}
    if glasses.rim == "goggles":
        return [tube(_strap_path(head, hinges), (1.0, 8.0), (0, 1, 0), 6, squareness=0.6)]
    return [_temple(glasses, _temple_path(head, hinges[side], marks[side], side)) for side in (1, -1)]


def _temple_path(
    head: PosedHead, hinge: Float64[ndarray, "3"], marks: Float64[ndarray, "5 3"], side: int
) -> Float64[ndarray, "n 3"]:
    """Returns the path from the hinge to the ear, outside the head, and down behind the ear."""
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
    """Moves points inside the skin out of it, twice, since another vertex may be nearest afterwards."""
    chosen = _side_vertices(head.model)[side]
    skin, normals = head.neutral[chosen].astype(np.float64), head.normals[chosen]
    for _ in range(2):
        nearest = (np.square(skin).sum(axis=1) - 2 * path @ skin.T).argmin(axis=1)
        outside = ((path - skin[nearest]) * normals[nearest]).sum(axis=1)
        path = path + np.clip(_TEMPLE_MM - outside, 0, 6)[:, None] * normals[nearest]
    return path


def _strap_path(head: PosedHead, hinges: Mapping[int, Float64[ndarray, "3"]]) -> Float64[ndarray, "n 3"]:
    """Returns the path around the back of the head, from one hinge to the other."""
    y = hinges[1][1]
    around = head.neutral[head.model.vertices_of("scalp")]
    near = around[np.abs(around[:, 1] - y - 10) < 14]
    depth, middle = float(near[:, 2].min()), float(near[:, 2].mean())
    half = float(np.abs(near[:, 0]).max())
    angle = np.linspace(0.12, 1, 12) * np.pi / 2
    left = np.stack(
        [(half + 7) * np.cos(angle), y + 14 * np.sin(angle), (depth - 5 - middle) * np.sin(angle) + middle], axis=1
    )
    return np.concatenate([hinges[1][None], left, left[-2::-1] * [-1, 1, 1], hinges[-1][None]])


def _in_front(head: PosedHead, points: Float64[ndarray, "n 3"]) -> Float64[ndarray, " n"]:
    """Returns the distance of points in front of the face, with or without its expression, mm along z."""
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
    """Returns the two nearest vertices in x and y, among the foremost of nearby cells (faster than a tree)."""
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
    """Returns the extent of the head to one side near places (y, z), mm."""
    chosen = _side_vertices(head.model)[side]
    beside = head.neutral[chosen]
    aside = np.abs(beside[None, :, 1:] - places[:, None].astype(np.float32))
    near = (aside[..., 0] < 5.0) & (aside[..., 1] < 5.0)
    return np.where(near, side * beside[:, 0].astype(np.float64), -1e3).max(axis=1)


@lru_cache(maxsize=4)
def _front_vertices(model: MorphableModel) -> Int64[ndarray, " n"]:
    found = model.vertices_of("skin", "brows", "eyes", "iris", "pupil", "scalp")
    place = model.mean[found]
    chosen = (np.abs(place[:, 0]) < 76) & (place[:, 1] > -58) & (place[:, 2] > 25)
    return found[chosen].astype(np.int64)


@lru_cache(maxsize=4)
def _side_vertices(model: MorphableModel) -> Mapping[int, Int32[ndarray, " n"]]:
    found = model.vertices_of("skin", "scalp", "neck")
    place = model.mean[found]
    aside = (place[:, 1] > -15) & (place[:, 1] < 115) & (place[:, 2] > -45) & (np.abs(place[:, 0]) > 45)
    return {side: found[aside & (side * place[:, 0] > 0)].astype(np.int32) for side in (1, -1)}


def outline(shape: str, count: int) -> Float64[ndarray, "n 2"]:
    """Returns the outline of the left lens from -1 to 1, from the nose over the top: x away from the nose, y up."""
    angle = np.pi - np.linspace(0, 2 * np.pi, count, endpoint=False)
    cosine, sine = np.cos(angle), np.sin(angle)
    power = {"round": 2.0, "oval": 2.2, "rectangle": 5.0, "square": 4.0, "cat-eye": 3.0, "aviator": 2.6}[shape]
    radius = (np.abs(cosine) ** power + np.abs(sine) ** power) ** (-1 / power)
    x, y = radius * cosine, radius * sine
    if shape == "cat-eye":
        y = y + 0.28 * np.clip(x, 0, 1) ** 2 * (y > 0)
        x = x * (1 + 0.10 * y)
    if shape == "aviator":
        y = y - 0.12 * x * (y < 0) - 0.10 * (y < 0) * np.cos(1.5 * x)
        x = x * (1 + 0.06 * y) + 0.05 * np.clip(-y, 0, 1)
    if shape in ("rectangle", "square"):
        x = x * (1 + 0.04 * y)
    shaped = np.stack([x, y], axis=1)
    return np.asarray(shaped / np.abs(shaped).max(axis=0))
