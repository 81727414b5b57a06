"""Objects that people hold to the face: phones, microphones, cups, cigarettes, straws, food."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy import ndarray

from datagen.appearance.accessories.head_fit import nearest_vertices
from datagen.appearance.accessories.materials import BLACK, SILVER, WHITE, cloth, draw_cloth_colour, draw_tint, smooth
from datagen.appearance.scene import Colour, Material, PosedHead, SceneMesh
from datagen.appearance.solids import Solid, box, ellipsoid, joined, lathe, scene_mesh, tube, unit
from datagen.random_streams import rounded, weighted_choice

# Weights of the objects.
_WEIGHTS = {"phone at ear": 0.16, "phone before face": 0.12, "microphone": 0.18, "cup": 0.16, "bottle": 0.06}
_WEIGHTS |= {"cigarette": 0.08, "straw": 0.06, "apple": 0.07, "sandwich": 0.06, "spoon": 0.05}
HELD = tuple(_WEIGHTS)
# Places on the mean head: both ears and the lips, mm.
_EARS_AND_LIPS = ((80.0, 8.0, 12.0), (-80.0, 8.0, 12.0), (0.0, -43.0, 106.0))

Piece = tuple[Solid, Material]


@final
@dataclass(frozen=True, kw_only=True)
class Held:
    """An object held to the mouth or the ear."""

    kind: str  # one of `HELD`
    is_left: bool  # whether it is at, or comes from, the left side
    colour: Colour  # linear
    second: Colour  # colour of the lid, head or filling, linear
    size: float  # factor on the usual size
    lean_deg: float
    gap_mm: float  # distance from the skin


def draw_held(rng: np.random.Generator) -> Held:
    """Draws an object that is held to the face."""
    kind = weighted_choice(rng, _WEIGHTS)
    dark = rng.uniform() < 0.6
    colour = BLACK if dark and kind.startswith(("phone", "micro")) else draw_cloth_colour(rng)
    if kind in ("apple", "sandwich"):
        colour = draw_tint(rng, 0.75, 0.7) if kind == "apple" else (0.55, 0.32, 0.12)
    return Held(
        kind=kind,
        is_left=bool(rng.uniform() < 0.5),
        colour=WHITE if kind == "cigarette" else colour,
        second=draw_tint(rng, float(rng.uniform(0, 0.8)), 0.6),
        size=rounded(np.clip(rng.normal(1, 0.12), 0.7, 1.4)),
        lean_deg=rounded(rng.normal(0, 12), 2),
        gap_mm=rounded(rng.gamma(1.5, 4), 2),
    )


def held_meshes(held: Held, head: PosedHead) -> list[SceneMesh]:
    """Makes the meshes of an object at the mouth or the ear of a head with its expression."""
    places = nearest_vertices(head.model, _EARS_AND_LIPS, ("ears", "lips"))
    left_ear, right_ear, lips = head.vertices[places].astype(np.float64)
    side = 1.0 if held.is_left else -1.0
    if held.kind == "phone at ear":
        axes = _axes(np.array([0, 1.0, -0.55]), np.array([side, 0.0, 0.35]))
        place = (left_ear if held.is_left else right_ear) + [side * (9 + held.gap_mm), -26, 16]
    elif held.kind == "phone before face":
        axes = _axes(np.array([0, 1.0, 0.15]), np.array([0, 0, 1.0]))
        place = lips + [side * 25, 10, 110 + 4 * held.gap_mm]
    else:
        place = lips
        lean = np.deg2rad(held.lean_deg)
        axes = _axes(np.array([np.sin(lean), np.cos(lean), 0.0]), np.array([0, 0, 1.0]))
    pieces = _pieces(held, axes, place, side)
    return [scene_mesh(f"held/{held.kind}{i}", "occluder", made, material) for i, (made, material) in enumerate(pieces)]


def _axes(up: ndarray, out: ndarray) -> ndarray:
    """Returns a rotation with the columns sideways, up, outward."""
    y = unit(up).astype(np.float64)
    x = unit(np.cross(y, out)).astype(np.float64)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _pieces(held: Held, axes: ndarray, lips: ndarray, side: float) -> list[Piece]:
    size, gap = held.size, held.gap_mm
    body = smooth(held.colour, 0.3)
    if held.kind.startswith("phone"):
        case = box((72 * size, 148 * size, 8.5))
        flat = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
        places = [np.array([x, 58 * size, 4.5]) for x in (-26 * size, -14 * size)]
        lens = joined([ellipsoid((5, 1.5, 5), 5, 10).placed(flat, place) for place in places])
        return [(case.placed(axes, lips), body), (lens.placed(axes, lips), smooth(BLACK, 0.1, 0.08))]
    if held.kind == "microphone":
        out = unit(np.array([0.25 * side, -0.75, 0.65])).astype(np.float64)
        ball = lips + (26 + gap) * np.array([0, -0.45, 0.9])
        path = ball + np.array([12.0, 30, 170])[:, None] * out
        handle = tube(path, np.array([[16.0, 16], [14, 14], [10, 10]]) * size, (1, 0, 0), 12)
        grille = ellipsoid((24 * size, 26 * size, 24 * size), 10, 16).moved(ball)
        return [(handle, body), (grille, cloth("linen", SILVER if sum(held.second) > 0.6 else BLACK, BLACK, 0.4))]
    if held.kind in ("cup", "bottle"):
        return _drinking(held, lips)
    if held.kind in ("cigarette", "straw", "spoon"):
        return _thin(held, lips, side)
    if held.kind == "apple":
        apple = ellipsoid((37 * size, 34 * size, 37 * size), 11, 18)
        return [(apple.placed(axes, lips + [0, -4, 33 * size + gap]), body)]
    bread, other = (
        box((105 * size, 16, 80 * size)).placed(axes, lips + np.array([0, y, 42 * size + gap])) for y in (8, -20)
    )
    filling = box((110 * size, 13, 84 * size)).placed(axes, lips + np.array([0, -6, 42 * size + gap]))
    return [
        (joined([bread, other]), cloth("fleece", held.colour, held.colour)),
        (filling, cloth("fleece", held.second, held.second)),
    ]


def _drinking(held: Held, lips: ndarray) -> list[Piece]:
    """Makes a cup or a bottle tipped towards the mouth."""
    size = held.size
    if held.kind == "cup":
        profile = np.array([[37.0, 0], [38, -1], [36, -40], [30, -90], [0.5, -92]]) * size
        tip, middle = 0.55, np.array([0.0, -3.0, 38 * size + held.gap_mm])
    else:
        profile = np.array([[0.5, 2.0], [12, 0], [12, -30], [34, -75], [34, -200], [0.5, -202]]) * size
        tip, middle = 1.0, np.array([0.0, -2.0, 8 + held.gap_mm])
    turn = np.array([[1, 0, 0], [0, np.cos(tip), np.sin(tip)], [0, -np.sin(tip), np.cos(tip)]]).T
    vessel = lathe(profile, 20)
    lid = lathe(np.array([[0.5, -4.0], [35, -4]]) * size, 20)
    pieces: list[Piece] = [(vessel.placed(turn, lips + middle), smooth(held.colour, 0.35))]
    if held.kind == "cup":
        pieces.append((lid.placed(turn, lips + middle), smooth(held.second, 0.5)))
    return pieces


def _thin(held: Held, lips: ndarray, side: float) -> list[Piece]:
    """Makes a cigarette, a straw or a spoon in the mouth."""
    start = lips + [side * 8, 0, -4]
    leaning, length, radius = {
        "cigarette": ([0.3 * side, -0.1, 1.0], 80.0, 3.8),
        "straw": ([0.15 * side, -0.9, 0.6], 150.0, 3.0),
        "spoon": ([0.4 * side, -0.15, 1.0], 150.0, 2.5),
    }[held.kind]
    way = unit(np.array(leaning)).astype(np.float64)
    stick = tube(start + np.array([0.0, 0.3, 1.0])[:, None] * (length * held.size) * way, radius, (0, 1, 0.2), 8)
    if held.kind == "spoon":
        bowl = ellipsoid((17, 5, 24), 7, 12).moved(start + 10 * way)
        return [(joined([stick, bowl]), smooth(SILVER, 0.15, 0.6))]
    pieces: list[Piece] = [(stick, smooth(held.colour, 0.8))]
    if held.kind == "cigarette":
        butt = tube(start + np.array([-2.0, 25.0])[:, None] * way, radius + 0.2, (0, 1, 0.2), 8)
        pieces.append((butt, smooth((0.5, 0.25, 0.07), 0.8)))
    return pieces
