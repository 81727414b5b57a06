"""Meshes of clothes, collars, ties and scarves, and of bare neck and shoulders."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from datagen.appearance.accessories.clothing.body import Body
from datagen.appearance.accessories.clothing.clothes import Clothes
from datagen.appearance.accessories.materials import cloth, skin_material
from datagen.appearance.scene import Colour, SceneMesh
from datagen.appearance.solids import Solid, joined, scene_mesh, sheet, tube, unit

SIDES = 48  # columns of a garment


def clothes_meshes(clothes: Clothes, body: Body, skin_rgb: Colour) -> list[SceneMesh]:
    """Makes the meshes of a garment, and of bare neck and shoulders."""
    neckline = _neckline(clothes)
    bare = 0.9 if clothes.garment == "straps" else float(neckline.max()) + 0.06
    meshes = [scene_mesh("body/skin", "clothes", body.skin(bare), skin_material(skin_rgb))]
    outer = cloth(clothes.weave, clothes.colour, clothes.second, 0.5 if clothes.weave == "leather" else 0.88)
    meshes.append(scene_mesh(f"clothes/{clothes.garment}", "clothes", _garment(clothes, body, neckline), outer))
    if clothes.garment == "suit":
        turn, place = np.meshgrid(np.linspace(-0.3, 0.3, 17), np.linspace(0.02, 0.95, 9))
        shirt = sheet(body.at(place, turn, 2.0 + 0.3 * clothes.looseness_mm), (6.0, 6.0))
        meshes.append(scene_mesh("clothes/shirt", "clothes", shirt, cloth("jersey", clothes.inner)))
    materials = {
        "outer": outer,
        "inner": cloth("jersey", clothes.inner),
        "trim": cloth("stripes_along" if clothes.seed % 3 == 0 else "jersey", clothes.trim, clothes.second, 0.6),
        "rib": cloth("rib", clothes.trim if clothes.seed % 4 == 0 else clothes.colour, clothes.second),
    }
    for kind, made in collar_solids(body, clothes, neckline):
        meshes.append(scene_mesh(f"clothes/{kind}", "clothes", made, materials[kind]))
    return meshes


def _neckline(clothes: Clothes) -> Float[ndarray, " c"]:
    """Returns the place along the body at which each column of the garment begins, around from the front."""
    turn = np.linspace(0, 1, SIDES + 1)
    off_front = np.minimum(turn, 1 - turn) * 2  # 0 is the front, 1 the back
    depth = clothes.depth
    ahead = np.exp(-((off_front / 0.35) ** 2))
    if clothes.garment == "v-neck":
        return 0.07 + (0.15 + 0.45 * depth) * np.clip(1 - off_front / 0.42, 0, 1)
    if clothes.garment == "suit":
        return 0.06 + (0.55 + 0.25 * depth) * np.clip(1 - off_front / 0.4, 0, 1) ** 0.9
    if clothes.garment == "shirt":
        opened = 0.0 if clothes.has_tie else 0.45 * depth
        return 0.03 + opened * np.clip(1 - off_front / 0.16, 0, 1)
    if clothes.garment == "straps":
        return 0.60 + 0.12 * depth * np.cos(2 * np.pi * 2 * turn) + 0.05 * ahead
    if clothes.garment in ("turtleneck", "zipped"):
        return np.full_like(turn, 0.02)
    wide = {"t-shirt": 0.05 + 0.10 * depth, "sweater": 0.05 + 0.06 * depth, "hoodie": 0.07}[clothes.garment]
    return wide + (0.04 + 0.22 * depth) * ahead


def _garment(clothes: Clothes, body: Body, neckline: Float[ndarray, " c"]) -> Solid:
    """Makes the cloth from the neckline down, with folds."""
    down = np.linspace(0, 1, 13)[:, None] ** 1.2
    place = neckline + (1 - neckline) * down
    turn = np.broadcast_to(np.linspace(0, 1, SIDES + 1), place.shape)
    rng = np.random.default_rng(clothes.seed)
    waves = rng.integers(2, 7, size=3)
    phases = rng.uniform(0, 2 * np.pi, size=3)
    folds = sum(np.sin(2 * np.pi * wave * turn + phase + 5 * place) for wave, phase in zip(waves, phases, strict=True))
    above = clothes.looseness_mm * (1 + (0.22 * folds + 0.5) * np.minimum(4 * down, 1)) + 0.8
    if clothes.garment == "suit":
        above = above + 5
    return sheet(body.at(place, turn, above), (1300 / clothes.scale_mm, 350 / clothes.scale_mm), is_closed=True)


# Material ("outer", "inner", "trim" or "rib") and shape.
Piece = tuple[str, Solid]


def collar_solids(body: Body, clothes: Clothes, neckline: Float[ndarray, " c"]) -> list[Piece]:
    """Makes the pieces at the neck of a garment, and a scarf over it."""
    garment = clothes.garment
    pieces: list[Piece] = []
    if garment in ("t-shirt", "v-neck", "sweater", "hoodie"):
        pieces.append(("rib", _rib(body, neckline, clothes, 5.0 if garment == "sweater" else 3.5)))
    if garment == "hoodie":
        pieces += [("outer", _hood(body, clothes)), ("inner", _strings(body, clothes))]
    if garment in ("shirt", "suit"):
        opened = 0.012 if clothes.has_tie else 0.02 + 0.05 * clothes.depth
        pieces.append(("inner" if garment == "suit" else "outer", _shirt_collar(body, opened)))
    if clothes.has_tie and garment in ("shirt", "suit"):
        pieces.append(("trim", _tie(body, clothes)))
    if garment == "suit":
        pieces.append(("outer", _lapels(body, clothes, neckline)))
    if garment == "turtleneck":
        pieces.append(("rib", _standing(body, -0.55, clothes, rolls=True)))
    if garment == "zipped":
        pieces.append(("outer", _standing(body, -0.45, clothes, rolls=False)))
    if garment == "straps":
        pieces.append(("outer", _straps(body, neckline, clothes)))
    if clothes.scarf > 0:
        pieces.append(("trim", _scarf(body, clothes)))
    return pieces


def _rib(body: Body, neckline: Float[ndarray, " c"], clothes: Clothes, half_mm: float) -> Solid:
    """Makes the knitted band along a neckline."""
    turn = np.linspace(0, 1, len(neckline))
    path = body.at(neckline, turn, 1.5 + clothes.looseness_mm * 0.5)
    outward = unit(body.at(neckline, turn, 10.0) - body.at(neckline, turn, 0.0))
    inner = body.at(np.maximum(neckline - 0.012 * half_mm, -1), turn, 1.0)
    below = body.at(neckline + 0.02, turn, clothes.looseness_mm + 2.2)
    rows = np.stack([inner, path + 1.5 * outward, below])
    return sheet(rows, (90.0, 1.0), is_closed=True)


def _hood(body: Body, clothes: Clothes) -> Solid:
    """Makes a hood on back and shoulders: a thick roll, higher at the back."""
    turn = np.linspace(0.06, 0.94, 33)
    behind = np.sin(np.pi * (turn - 0.06) / 0.88)
    path = body.at(0.10 + 0.04 * np.cos(2 * np.pi * turn), turn, clothes.looseness_mm + 8 + 14 * behind)
    radii = np.stack([9 + 14 * behind, 8 + 20 * behind], axis=1)
    return tube(path, radii, body.head_from_torso[:, 1], sides=10)


def _strings(body: Body, clothes: Clothes) -> Solid:
    strings = []
    for side in (-1, 1):
        place = np.linspace(0.1, 0.1 + 0.35 + 0.1 * (clothes.seed % 5) / 5, 8)
        strings.append(tube(body.at(place, np.full(8, side * 0.045), clothes.looseness_mm + 7), 2.2, sides=5))
    return joined(strings)


def _shirt_collar(body: Body, opened: float) -> Solid:
    """Makes a folded collar with points in front."""
    turn = np.linspace(opened, 1 - opened, 41)
    near = np.exp(-((np.minimum(turn, 1 - turn) - opened) / 0.07))
    ones = np.ones_like(turn)
    rise = 1 - 0.35 * near
    profile = [
        (0.03 * ones, 2.5 * ones),
        (-0.40 * rise, 3.5 * ones),
        (-0.43 * rise, 5.5 * ones),
        (-0.38 * rise, 8.0 * ones),
        (-0.10 * ones, 12.0 - 1.0 * near),
        (0.07 + 0.15 * near, 9.0 + 2.0 * near),
    ]
    leaning = turn + np.where(turn < 0.5, 1, -1) * 0.012 * near
    rows = [
        body.at(place, leaning if i == len(profile) - 1 else turn, above) for i, (place, above) in enumerate(profile)
    ]
    return sheet(np.stack(rows), (12.0, 2.0))


def _tie(body: Body, clothes: Clothes) -> Solid:
    """Makes the knot and the blade of a tie."""
    place = np.array([-0.10, -0.04, 0.04, 0.06, 0.12, 0.3, 0.6, 1.0])
    half_mm = np.array([13.0, 15.0, 11.0, 10.0, 16.0, 22.0, 30.0, 38.0])
    above = np.array([7.0, 14.0, 14.0, 10.0, 7.0, 6.0, 6.0, 6.0]) + 0.4 * clothes.looseness_mm
    middle = body.at(place, np.zeros(8), above)
    sideways = unit(body.at(place, np.full(8, 0.02), 0.0) - body.at(place, np.full(8, -0.02), 0.0))
    across = np.array([-1.0, -0.6, 0, 0.6, 1])
    dome = body.at(place, np.zeros(8), above + 4) - middle
    points = middle[:, None] + (half_mm[:, None] * across)[..., None] * sideways[:, None]
    return sheet(points + (1 - across**2)[None, :, None] * dome[:, None], (2.0, 8.0))


def _lapels(body: Body, clothes: Clothes, neckline: Float[ndarray, " c"]) -> Solid:
    """Makes lapels along the neckline, and the collar behind the neck."""
    turn = np.linspace(0, 1, len(neckline))
    above = clothes.looseness_mm + 6.0
    sides = []
    for side in (-1, 1):
        s = np.linspace(0.004, 0.30, 15)
        place = np.interp(s, turn, neckline)
        wide = 0.055 * np.clip(1 - np.abs(s - 0.13) / 0.13, 0.1, 1)
        rows = [
            body.at(place, side * (s + part * wide), above + 3 + 3 * np.sin(np.pi * part)) for part in (0.0, 0.5, 1.0)
        ]
        sides.append(sheet(np.stack(rows if side > 0 else rows[::-1]), (8.0, 2.0)))
    around = np.linspace(0.17, 0.83, 25)
    profile = [(0.04, 6.0), (-0.22, 7.0), (-0.24, 10.0), (0.0, 14.0), (0.12, above + 6)]
    band = np.stack([body.at(np.full(25, place), around, height) for place, height in profile])
    return joined([*sides, sheet(band, (8.0, 2.0))])


def _standing(body: Body, top: float, clothes: Clothes, *, rolls: bool) -> Solid:
    """Makes a collar that stands around the neck, rolled over or with an open edge."""
    turn = np.linspace(0, 1, 49)
    wobble = 1 + 0.06 * np.sin(2 * np.pi * 3 * turn + clothes.seed % 7)
    loose = 3.0 if rolls else 6.0
    profile = [(0.08, clothes.looseness_mm + 2), (-0.02, loose + 2.5), (0.6 * top, loose + 1.5), (top, loose)]
    if rolls:
        profile = [
            (0.05, loose + 3),
            (-0.05, loose + 4.5),
            (0.6 * top, loose + 6),
            (top, loose + 4),
            (top - 0.02, loose + 2),
            (top, loose),
            (0.5 * top, loose),
        ]
    else:
        profile += [(top - 0.01, loose - 1.5), (0.5 * top, loose - 2.5)]
    rows = [body.at(np.clip(place * wobble, -0.98, 1), turn, height) for place, height in profile[::-1]]
    return sheet(np.stack(rows), (24.0, 3.0), is_closed=True)


def _straps(body: Body, neckline: Float[ndarray, " c"], clothes: Clothes) -> Solid:
    """Makes two straps over the shoulders."""
    half_mm = 3.0 + 12.0 * clothes.depth
    straps = []
    for side in (-1, 1):
        s = np.linspace(0, 1, 17)
        turn = np.interp(s, [0, 0.3, 0.5, 0.7, 1], [0.10, 0.16, 0.25, 0.34, 0.40])
        top = np.interp(s, [0, 0.3, 0.5, 0.7, 1], [0.0, 0.32, 0.26, 0.32, 0.0])
        low = np.interp(turn, np.linspace(0, 1, len(neckline)), neckline) + 0.03
        place = np.where(top > 0, np.minimum(low, low + (0.26 - low) * np.sin(np.pi * s) ** 0.6), low)
        path = body.at(place, side * turn, 2.0)
        upward = body.at(place, side * turn, 12.0) - path
        ahead = np.gradient(path, axis=0)
        sideways = unit(np.cross(ahead, upward)) * half_mm * side
        straps.append(sheet(np.stack([path - sideways, path + 0.15 * upward, path + sideways])[::side], (8.0, 1.0)))
    return joined(straps)


def _scarf(body: Body, clothes: Clothes) -> Solid:
    """Makes a scarf with two turns around the neck, and an end that hangs down."""
    turn = np.linspace(0, 2, 57)
    rng = np.random.default_rng(clothes.seed)
    waves = sum(np.sin(2 * np.pi * k * turn + rng.uniform(0, 6)) for k in (1, 3, 5)) / 3
    place = -0.05 - 0.28 * (turn - 1) + 0.05 * waves
    path = body.at(np.clip(place, -0.7, 1), turn + 0.07, clothes.scarf * (0.75 + 0.15 * waves))
    radii = clothes.scarf * np.stack([0.8 + 0.15 * waves, 1.05 - 0.2 * waves], axis=1)
    ring = tube(path, radii, body.head_from_torso[:, 1], sides=9)
    down = np.linspace(0.0, 0.9, 9)
    end = body.at(down, np.full(9, 0.05), clothes.looseness_mm + clothes.scarf * np.linspace(1.5, 0.6, 9))
    hanging = tube(end, (0.5 * clothes.scarf, 1.9 * clothes.scarf), body.head_from_torso[:, 0], sides=8)
    return joined([ring, hanging])
