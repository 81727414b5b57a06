"""Earrings, necklaces and piercings; earphones, headphones and headsets."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from datagen.appearance.accessories.clothing.body import Body
from datagen.appearance.accessories.head_fit import fit_skull, nearest_on_side
from datagen.appearance.accessories.materials import BLACK, GOLD, SILVER, WHITE, draw_tint, smooth
from datagen.appearance.scene import Colour, PosedHead, SceneMesh
from datagen.appearance.solids import Solid, ellipsoid, joined, lathe, scene_mesh, tube
from datagen.random_streams import rounded

EARRINGS = ("none", "stud", "hoop", "drop")
SOUND = ("none", "buds", "wired", "headphones", "headset", "round neck")
PIERCINGS = ("none", "nose stud", "nose ring", "septum", "brow", "lip")
# Places on the mean head: ear lobe, ear canal, side of the nose, below the nose, end of the brow, below the lower lip.
_PLACES = ((77.0, -17, 5), (76, 4, 8), (15, -12, 104), (0, -20, 109), (56, 46, 78), (9, -53, 104))
_REGIONS = ("ears", "ears", "skin", "skin", "brows", "skin")


@final
@dataclass(frozen=True, kw_only=True)
class Jewellery:
    """Jewellery and earphones."""

    earrings: str  # one of `EARRINGS`
    one_ear: bool  # whether only the left ear has an earring
    piercing: str  # one of `PIERCINGS`
    necklace: int  # 0 is none, 1 a chain, 2 beads, 3 a chain with a pendant
    sound: str  # one of `SOUND`
    size: float  # 0..1
    metal: Colour  # linear colour
    stone: Colour  # linear colour of beads and stones
    gear: Colour  # linear colour of earphones


def draw_jewellery(rng: np.random.Generator, femininity: float, sound_share: float, share: float) -> Jewellery:
    """Draws jewellery. `share` is the share of women with jewellery, `sound_share` that of people with earphones."""
    wears = share * (0.25 + 0.75 * femininity)
    earrings = str(rng.choice(EARRINGS[1:])) if rng.uniform() < wears else "none"
    return Jewellery(
        earrings=earrings,
        one_ear=bool(rng.uniform() < 0.1 + 0.3 * (1 - femininity)),
        piercing=str(rng.choice(PIERCINGS[1:])) if rng.uniform() < 0.12 * wears else "none",
        necklace=int(rng.integers(1, 4)) if rng.uniform() < 0.7 * wears else 0,
        sound=str(rng.choice(SOUND[1:], p=[0.3, 0.2, 0.25, 0.1, 0.15])) if rng.uniform() < sound_share else "none",
        size=rounded(rng.beta(1.2, 2.5)),
        metal=GOLD if rng.uniform() < 0.55 else SILVER,
        stone=WHITE if rng.uniform() < 0.4 else draw_tint(rng, 0.7, 0.6),
        gear=(WHITE, BLACK, draw_tint(rng, 0.6, 0.5))[int(rng.choice(3, p=[0.4, 0.45, 0.15]))],
    )


def jewellery_meshes(jewellery: Jewellery, head: PosedHead, body: Body) -> list[SceneMesh]:
    """Makes the meshes of jewellery and earphones on a head."""
    metal, stones = _jewels(jewellery, head, body)
    made = {
        "metal": (metal, smooth(jewellery.metal, 0.2, 0.6)),
        "stones": (stones, smooth(jewellery.stone, 0.15, 0.08)),
        "gear": (_sound(jewellery, head, body), smooth(jewellery.gear, 0.4, 0.05)),
    }
    return [
        scene_mesh(f"jewellery/{name}", "jewellery", joined(parts), material)
        for name, (parts, material) in made.items()
        if parts
    ]


def _jewels(jewellery: Jewellery, head: PosedHead, body: Body) -> tuple[list[Solid], list[Solid]]:
    """Makes the parts of metal, and stones and beads."""
    metal: list[Solid] = []
    stones: list[Solid] = []
    marks = {side: _marks(head, side) for side in (1, -1)}
    size = jewellery.size
    for side in (1,) if jewellery.one_ear else (1, -1):
        lobe = marks[side][0] + [side * 2.0, 0, 1]
        if jewellery.earrings == "stud":
            stones.append(_ball(lobe, 2.0 + 2.5 * size))
        if jewellery.earrings == "hoop":
            radius = 6 + 22 * size
            metal.append(_ring(lobe - [0, radius, 0], radius, 0.9 + 0.8 * size, (0, 1)))
        if jewellery.earrings == "drop":
            long = 14 + 38 * size
            metal.append(tube(np.stack([lobe, lobe - [0, 0.5 * long, 0], lobe - [0, long, 0]]), 0.7, (0, 0, 1), 5))
            stones.append(ellipsoid((4, 7, 4), 6, 8).moved(lobe - [0, long, 0], 0.8 + 0.6 * size))
    metal += _piercing(jewellery.piercing, marks)
    if jewellery.necklace:
        chain, pendant = _necklace(jewellery, body)
        (stones if jewellery.necklace == 2 else metal).append(chain)
        stones += pendant
    return metal, stones


def _piercing(kind: str, marks: dict[int, Float64[ndarray, "6 3"]]) -> list[Solid]:
    left, right = marks[1], marks[-1]
    if kind == "nose stud":
        return [_ball(left[2] + [0.8, 0, 0.3], 1.6)]
    if kind == "nose ring":
        return [_ring(left[2] + [0.5, -4.5, -0.5], 4.8, 0.7, (1, 2))]
    if kind == "septum":
        return [_ring(left[3] * [0, 1, 1] + [0, -3.5, -1.5], 5.0, 0.9, (0, 1))]
    if kind == "brow":
        return [_ball(right[4] + [0, 3, 1.5], 1.7), _ball(right[4] + [0, -4, 1.5], 1.7)]
    if kind == "lip":
        return [_ball(left[5] + [0, 0, 0.8], 1.7)]
    return []


def _necklace(jewellery: Jewellery, body: Body) -> tuple[Solid, list[Solid]]:
    turn = np.linspace(0, 1, 65)
    ahead = np.exp(-((np.minimum(turn, 1 - turn) / 0.16) ** 2))
    place = 0.04 + (0.08 + 0.3 * jewellery.size) * ahead
    path = body.at(place, turn, 1.5 if jewellery.necklace != 2 else 3.0).astype(np.float64)
    if jewellery.necklace == 2:
        beads = [ellipsoid((1, 1, 1), 5, 6).moved(at, 3.0 + 2 * jewellery.size) for at in path[:-1]]
        return joined(beads), []
    chain = tube(path, 1.0, (0.1, 1.0, 0.2), 5)
    if jewellery.necklace == 1:
        return chain, []
    return chain, [ellipsoid((6, 8, 2.5), 6, 10).moved(path[0] - [0, 7, -1])]


def _sound(jewellery: Jewellery, head: PosedHead, body: Body) -> list[Solid]:
    """Makes earphones, headphones or a headset."""
    parts: list[Solid] = []
    if jewellery.sound == "round neck":
        path = body.at(np.full(25, 0.03), np.linspace(0.09, 0.91, 25), 16.0)
        cups = [ellipsoid((22, 32, 30), 9, 14).moved(end) for end in (path[0], path[-1])]
        return [tube(path, (4.0, 8.0), (0, 1, 0.1), 8), *cups]
    for side in (1, -1):
        canal = _marks(head, side)[1] + [side * 3, 0, 2]
        if jewellery.sound == "buds":
            stem = np.stack([canal, canal + [side * 3, -8, 4], canal + [side * 3, -26, 7]])
            parts += [_ball(canal, 7.0), tube(stem, 3.2, (0, 0, 1), 8)]
        if jewellery.sound == "wired":
            below = body.at(np.array([0.1, 0.7]), np.array([side * 0.06, side * 0.02]), 8.0)
            wire = np.stack([canal, canal + [side * 3, -45, 6], below[0], below[1]])
            parts += [_ball(canal, 6.5), tube(wire, 1.0, (0, 0.2, 1), 5)]
        if jewellery.sound in ("headphones", "headset"):
            cup = lathe(np.array([[0.5, 13.0], [24, 12], [31, 4], [32, -6], [28, -10]]), 18)
            turn = np.array([[0.0, side, 0], [1, 0, 0], [0, 0, -side]])
            parts.append(cup.placed(turn, canal + [side * 12, 4, -6]))
    if jewellery.sound in ("headphones", "headset"):
        parts.append(_band(head))
    if jewellery.sound == "headset":
        parts += _boom(head)
    return parts


def _band(head: PosedHead) -> Solid:
    """Makes the headband over the crown."""
    skull = fit_skull(head)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 25)
    rise = np.pi / 2 - np.abs(angle) * (np.pi / 2 + 0.25) / (np.pi / 2)
    above = 15 + 14 * (np.abs(angle) / (np.pi / 2)) ** 2
    path = skull.at(rise, np.where(angle < 0, -1.0, 1.0) * 1.62, above)
    return tube(path, (10.0, 3.5), (0.0, 0.3, 1.0), 8, squareness=0.4)


def _boom(head: PosedHead) -> list[Solid]:
    """Makes a microphone in front of the mouth and its arm."""
    _, canal, *_, lip = _marks(head, 1)
    end = lip + [14, 0, 18]
    path = np.stack([canal + [18, -10, 8], 0.5 * (canal + end) + [26, -12, 14], end])
    return [tube(path, 1.8, (0, 1, 0.2), 6), _ball(end, 6.5)]


def _ball(place: Float64[ndarray, "3"], radius: float) -> Solid:
    return ellipsoid((radius, radius, radius), 7, 10).moved(place)


def _ring(place: Float64[ndarray, "3"], radius: float, thick: float, plane: tuple[int, int]) -> Solid:
    """Makes a ring in the plane of two axes."""
    angle = np.linspace(0, 2 * np.pi, 25)
    path = np.tile(place, (25, 1))
    path[:, plane[0]] += radius * np.sin(angle)
    path[:, plane[1]] += radius * np.cos(angle)
    return tube(path, thick, np.eye(3)[3 - plane[0] - plane[1]], 6)


def _marks(head: PosedHead, side: int) -> Float64[ndarray, "6 3"]:
    """Returns the `_PLACES` on one side of a head; side 1 is the left."""
    at = zip(_PLACES, _REGIONS, strict=True)
    found = [nearest_on_side(head.model, (place,), side, (region,)) for place, region in at]
    return head.vertices[np.concatenate(found)].astype(np.float64)
