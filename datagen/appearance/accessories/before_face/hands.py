"""Hands at or in front of the face, with a palm, five jointed fingers with nails, and a forearm in a sleeve."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np
from jaxtyping import Float64, Int32
from numpy import ndarray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from datagen.appearance.accessories.head_fit import nearest_on_side
from datagen.appearance.accessories.materials import cloth, draw_cloth_colour, draw_tint, skin_material, smooth
from datagen.appearance.scene import Colour, PosedHead, SceneMesh
from datagen.appearance.solids import Solid, ellipsoid, joined, scene_mesh, tube, unit
from datagen.random_streams import rounded, weighted_choice
from pix2face.models.morphable_model import MorphableModel


@final
@dataclass(frozen=True)
class Pose:
    """The pose of a right hand; a left hand is its mirror image."""

    share: float  # weight among all poses
    near: tuple[float, float, float]  # place of the palm on the mean face, mm
    away_mm: float  # distance of the palm's centre from that place, towards the back of the hand
    fingers: tuple[float, float, float]  # direction of the fingers
    palm: tuple[float, float, float]  # direction that the palm faces
    curl_deg: float  # bend of the fingers at each joint
    touches: bool = True  # whether it rests on the face, or is in front of it


POSES: Mapping[str, Pose] = {
    "chin": Pose(0.20, (-10, -84, 82), 30, (0.75, 0.55, 0.3), (0.2, 0.95, -0.3), 62),
    "mouth": Pose(0.14, (0, -44, 108), 18, (0.75, 0.6, -0.1), (0.05, 0.1, -1.0), 14),
    "cheek": Pose(0.22, (-62, -32, 48), 16, (-0.05, 0.95, -0.2), (0.92, 0.1, -0.4), 22),
    "eye": Pose(0.10, (-34, 22, 95), 20, (0.25, 0.95, -0.1), (0.15, 0.0, -1.0), 12),
    "salute": Pose(0.05, (-58, 48, 76), 20, (0.9, 0.35, 0.15), (0.25, -0.85, -0.45), 4),
    "wave": Pose(0.12, (-30, -20, 105), -110, (0.1, 1.0, 0.0), (0.0, 0.05, 1.0), 10, touches=False),
    "hair": Pose(0.12, (-60, 100, 30), 20, (0.35, 0.9, -0.3), (0.75, -0.35, -0.5), 28),
    "forehead": Pose(0.05, (0, 60, 105), 18, (0.6, 0.8, -0.1), (0.0, -0.1, -1.0), 10),
}
_TOUCH_MM = 0.5  # distance between hand and face
# Fingers from the index to the little finger: root on the palm (x, y), length and radius, mm.
_FINGERS = ((-31.0, 44.0, 72.0, 8.3), (-10.5, 48.0, 80.0, 8.5), (10.5, 46.0, 74.0, 8.0), (30.0, 38.0, 58.0, 6.9))


@final
@dataclass(frozen=True, kw_only=True)
class Hand:
    """A hand."""

    pose: str  # one of `POSES`
    is_left: bool
    is_pair: bool  # whether the other hand has the mirrored pose
    scale: float  # 1 is the size of a man's hand
    # bend of index to little finger at each joint, in addition to that of the pose
    curl_deg: tuple[float, float, float, float]
    spread_deg: float  # angle between neighbouring fingers
    turn_deg: float  # rotation about the palm's normal
    slide_mm: tuple[float, float, float]  # offset to the left, up and out
    sleeve: Colour  # linear colour
    has_sleeve: bool  # whether the arm has a sleeve, or is bare
    nail: Colour  # linear colour of the nail varnish; negative for none


def draw_hand(rng: np.random.Generator, femininity: float) -> Hand:
    """Draws a hand."""
    pose = weighted_choice(rng, {name: pose.share for name, pose in POSES.items()})
    curls = rng.normal(0, 8, size=4).round(2).tolist()
    if rng.uniform() < 0.2:  # single fingers bent, as in pointing
        curls = [float(c) for c in np.array([0.0, 55, 60, 60]) * rng.choice([0, 1], size=4, p=[0.4, 0.6])]
    slide = rng.normal(0, 8 if POSES[pose].touches else 30, size=3).round(2).tolist()
    return Hand(
        pose=pose,
        is_left=bool(rng.uniform() < 0.5),
        is_pair=pose in ("cheek", "eye", "hair") and bool(rng.uniform() < 0.2),
        scale=rounded(np.clip(rng.normal(1.0 - 0.12 * femininity, 0.06), 0.72, 1.2)),
        curl_deg=(curls[0], curls[1], curls[2], curls[3]),
        spread_deg=rounded(rng.uniform(0, 12), 2),
        turn_deg=rounded(rng.normal(0, 18), 2),
        slide_mm=(slide[0], slide[1], slide[2]),
        sleeve=draw_cloth_colour(rng),
        has_sleeve=bool(rng.uniform() < 0.6),
        nail=draw_tint(rng, 0.7, 0.6) if rng.uniform() < 0.3 * femininity else (-1.0, -1.0, -1.0),
    )


def hand_meshes(hand: Hand, head: PosedHead, skin_rgb: Colour) -> list[SceneMesh]:
    """Makes the meshes of hands: skin, nails and sleeves."""
    meshes: list[SceneMesh] = []
    for is_left in (hand.is_left, not hand.is_left) if hand.is_pair else (hand.is_left,):
        skin, nails = _shaped(hand)
        turn, place = _placed(hand, head, skin, is_left)
        arm, cuff = _forearm(hand, turn, place)
        red, green, blue = (min(1.0, 1.15 * part) for part in skin_rgb)
        nail = (red, green, blue) if hand.nail[0] < 0 else hand.nail
        parts = {
            "skin": (joined([skin.placed(turn, place, hand.scale), arm]), skin_material(skin_rgb)),
            "nails": (nails.placed(turn, place, hand.scale), smooth(nail, 0.3)),
        }
        if hand.has_sleeve:
            parts["sleeve"] = cuff, cloth("jersey", hand.sleeve)
        for name, (made, material) in parts.items():
            seen = made.mirrored() if is_left else made
            meshes.append(scene_mesh(f"hand/{name}", "occluder", seen, material))
    return meshes


@lru_cache(maxsize=4)
def _shaped(hand: Hand) -> tuple[Solid, Solid]:
    """Makes palm, fingers and nails, with x towards the little finger, y along the fingers, z out of the palm."""
    pose = POSES[hand.pose]
    profile = np.array([[-58, 27, 17], [-42, 32, 17], [-18, 39, 16], [10, 41, 14], [34, 41, 11.5], [50, 36, 8.5]])
    middle = np.stack([0 * profile[:, 0], profile[:, 0], np.array([0, 0, 1.0, 1.0, 0, 0])], axis=1)
    skin, nails = [tube(middle, profile[:, 1:], (0, 0, 1), 12, squareness=0.45)], []
    for place, (x, y, length, radius) in enumerate(_FINGERS):
        bend = np.deg2rad(np.clip(pose.curl_deg + hand.curl_deg[place], -8, 95))
        aside = np.deg2rad(-hand.spread_deg * (1.5 - place))
        finger, nail = _finger(np.array([x, y, 0.0]), length, radius, (bend, -aside))
        skin.append(finger)
        nails.append(nail)
    thumb, nail = _thumb(np.deg2rad(10 + 0.35 * pose.curl_deg))
    return joined([*skin, thumb]), joined([*nails, nail])


def _finger(
    root: Float64[ndarray, "3"], length: float, radius: float, bends: tuple[float, float]
) -> tuple[Solid, Solid]:
    """Makes a finger of three bones, and its nail; `bends` are the angles at each joint and to the side."""
    curl, aside = bends
    bones = length * np.array([0.46, 0.30, 0.24])
    angles = np.cumsum([0.9 * curl, 1.0 * curl, 0.6 * curl])
    ways = np.stack([np.sin(aside) * np.cos(angles), np.cos(aside) * np.cos(angles), np.sin(angles)], axis=1)
    joints = root + np.concatenate([np.zeros((1, 3)), np.cumsum(bones[:, None] * ways, axis=0)])
    start = root - 14 * ways[0]
    tip = joints[3] - radius * 0.55 * ways[2]
    path = [start, joints[0], 0.5 * (joints[0] + joints[1]), joints[1], 0.5 * (joints[1] + joints[2]), joints[2]]
    path += [0.5 * (joints[2] + tip), tip, joints[3] - 0.15 * radius * ways[2], joints[3] + 0.1 * radius * ways[2]]
    thick = radius * np.array([1.05, 1.08, 0.98, 1.06, 0.92, 0.97, 0.9, 0.80, 0.55, 0.2])
    sideways = np.array([np.cos(aside), -np.sin(aside), 0.0])
    finger = tube(
        np.stack(path), np.stack([thick, 0.92 * thick], axis=1), np.cross(sideways, [0, 1.0, 0.01]) + [0, -0.2, 0.2], 8
    )
    out = np.cross(ways[2], sideways)
    turn = np.stack([sideways, ways[2], out], axis=1)
    nail = ellipsoid((0.62 * radius, 0.75 * radius, 1.4), 6, 8)
    back = out * (1.0 if out[2] < 0 or angles[2] > np.pi / 2 else -1.0)
    return finger, nail.placed(turn, tip + 0.30 * radius * ways[2] + 0.62 * radius * back)


def _thumb(bend: float) -> tuple[Solid, Solid]:
    way = unit(np.array([-0.72, 0.62, 0.30])).astype(np.float64)
    root = np.array([-26.0, -34.0, 6.0])
    knuckle = root + 44 * way
    further = unit(way + np.array([0.35, 0.5, 0.55]) * bend).astype(np.float64)
    tip = knuckle + 46 * further
    path = np.stack(
        [root, root + 22 * way, knuckle, knuckle + 24 * further, tip - 6 * further, tip - 1.5 * further, tip]
    )
    thick = np.array([15.0, 14.0, 10.8, 10.2, 8.8, 5.5, 2.0])
    thumb = tube(path, np.stack([thick, 0.9 * thick], axis=1), (0, 0.1, 1), 8)
    out = unit(np.cross(further, np.array([0.6, 0.5, 0.6]))).astype(np.float64)
    out = out if out[2] < 0 else -out
    side = np.cross(further, out)
    nail = ellipsoid((6.2, 7.5, 1.5), 6, 8).placed(
        np.stack([side, further, out], axis=1), tip - 8 * further + 6.2 * out
    )
    return thumb, nail


def _placed(
    hand: Hand, head: PosedHead, skin: Solid, is_left: bool
) -> tuple[Float64[ndarray, "3 3"], Float64[ndarray, "3"]]:
    """Returns rotation and place of a hand, resting on the face or in front of it; mirrored for a left hand."""
    pose = POSES[hand.pose]
    palm = unit(np.array(pose.palm)).astype(np.float64)
    along = np.array(pose.fingers) - (np.array(pose.fingers) @ palm) * palm
    along = unit(Rotation.from_rotvec(np.deg2rad(hand.turn_deg) * palm).apply(along)).astype(np.float64)
    turn = np.stack([np.cross(along, palm), along, palm], axis=1)
    flip = np.array([-1.0 if is_left else 1.0, 1.0, 1.0])
    near = head.vertices[nearest_on_side(head.model, (pose.near,), -1 if is_left else 1)[0]] * flip
    place = near + np.array(hand.slide_mm) * [-1, 1, 0.3] - (pose.away_mm + 8) * palm
    # So that the fingers are at the place, not the wrist.
    place = place - 22 * hand.scale * along
    local = hand.scale * (skin.vertices[::3].astype(np.float64) @ turn.T)
    chosen = _sparse_skin(head.model)
    face, normals = head.vertices[chosen] * flip, head.normals[chosen] * flip
    tree = cKDTree(face)
    for _ in range(2 if pose.touches else 1):
        nearest = tree.query(local + place)[1]
        before = ((local + place - face[nearest]) * normals[nearest]).sum(axis=1)
        deepest = int(before.argmin())
        if before[deepest] < _TOUCH_MM or pose.touches:
            cosine = max(0.35, float(-normals[nearest[deepest]] @ palm))
            place = place - np.clip((_TOUCH_MM - before[deepest]) / cosine, -40, 90) * palm
    return turn, place


def _forearm(hand: Hand, turn: Float64[ndarray, "3 3"], place: Float64[ndarray, "3"]) -> tuple[Solid, Solid]:
    """Makes a forearm from the wrist down and outward, and a sleeve over it."""
    size = hand.scale
    along, palm = turn[:, 1], turn[:, 2]
    wrist = place - 52 * size * along
    elbow = unit(-0.75 * along + np.array([-0.30, -0.75, 0.10]) - 0.35 * palm).astype(np.float64)
    s = np.linspace(0, 1, 7)[:, None]
    path = wrist - 260 * size * (s * (1 - s) * 0.5 * along) + 260 * size * s * elbow
    radii = size * np.stack([np.linspace(27, 42, 7), np.linspace(18, 38, 7)], axis=1)
    arm = tube(path, radii, palm, 10)
    cuff = tube(path[2:], radii[2:] + 6.0 + 6.0 * np.linspace(0, 1, 5)[:, None], palm, 12)
    return arm, cuff


@lru_cache(maxsize=4)
def _sparse_skin(model: MorphableModel) -> Int32[ndarray, " n"]:
    """Returns every fifth vertex of the surface that a hand can touch."""
    return model.vertices_of("skin", "brows", "lips", "eyes", "ears", "scalp", "neck")[::5]
