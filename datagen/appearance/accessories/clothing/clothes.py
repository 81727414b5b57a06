"""Clothes around the neck, and the neck and shoulders that they leave bare."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from datagen.appearance.accessories.clothing.body import Body
from datagen.appearance.accessories.clothing.clothes_choice import Clothes
from datagen.appearance.accessories.clothing.collars import collar_solids
from datagen.appearance.accessories.colours import Colour, cloth, skin_material
from datagen.appearance.scene import SceneMesh
from datagen.appearance.solids import Solid, scene_mesh, sheet

SIDES = 48  # columns of a garment


def clothes_meshes(clothes: Clothes, body: Body, skin_rgb: Colour) -> list[SceneMesh]:
    """Bare neck and shoulders, and the garment."""
    neckline = _neckline(clothes)
    bare = 0.9 if clothes.garment == "straps" else float(neckline.max()) + 0.06
    meshes = [scene_mesh("body/skin", "clothes", body.skin(bare), skin_material(skin_rgb))]
    outer = cloth(clothes.weave, clothes.colour, clothes.second, 0.5 if clothes.weave == "leather" else 0.88)
    meshes.append(scene_mesh(f"clothes/{clothes.garment}", "clothes", _garment(clothes, body, neckline), outer))
    if clothes.garment == "suit":
        below = _sheet_below(body, clothes)
        meshes.append(scene_mesh("clothes/shirt", "clothes", below, cloth("jersey", clothes.inner)))
    materials = {
        "outer": outer,
        "inner": cloth("jersey", clothes.inner),
        "trim": cloth("stripes_along" if clothes.seed % 3 == 0 else "jersey", clothes.trim, clothes.second, 0.6),
        "rib": cloth("rib", clothes.trim if clothes.seed % 4 == 0 else clothes.colour, clothes.second),
    }
    for kind, made in collar_solids(clothes.garment, body, clothes, neckline):
        meshes.append(scene_mesh(f"clothes/{kind}", "clothes", made, materials[kind]))
    return meshes


def _neckline(clothes: Clothes) -> Float[ndarray, " c"]:
    """Place along the body where the garment begins, for each of its columns from the front once around."""
    turn = np.linspace(0, 1, SIDES + 1)
    off_front = np.minimum(turn, 1 - turn) * 2  # 0 front, 1 back
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
    """The cloth from the neckline down, with folds."""
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


def _sheet_below(body: Body, clothes: Clothes) -> Solid:
    """What is worn under a suit, where its neckline shows it."""
    turn, place = np.meshgrid(np.linspace(-0.3, 0.3, 17), np.linspace(0.02, 0.95, 9))
    return sheet(body.at(place, turn, 2.0 + 0.3 * clothes.looseness_mm), (6.0, 6.0))
