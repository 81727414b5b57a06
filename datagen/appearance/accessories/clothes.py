"""Clothes around the neck, and the neck and shoulders that they leave bare."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from datagen.appearance.accessories.body import Body
from datagen.appearance.accessories.collars import collar_solids
from datagen.appearance.accessories.colours import WHITE, Colour, cloth, draw_cloth_colour, skin_material
from datagen.appearance.accessories.solids import Solid, scene_mesh, sheet
from datagen.appearance.person import Person
from datagen.appearance.scene import SceneMesh

GARMENTS = ("t-shirt", "v-neck", "sweater", "shirt", "suit", "turtleneck", "hoodie", "zipped", "straps")
_SHARE = {
    "male": (0.26, 0.07, 0.12, 0.20, 0.13, 0.04, 0.10, 0.08, 0.0),
    "female": (0.20, 0.15, 0.12, 0.13, 0.06, 0.08, 0.08, 0.06, 0.12),
}
_PLAIN = ("jersey", "jersey", "knit", "linen", "denim", "fleece", "leather", "rib")
_PATTERNS = (
    "plaid",
    "check",
    "stripes_across",
    "stripes_along",
    "dots",
    "herringbone",
    "flowers",
    "camouflage",
    "print",
)
SIDES = 48  # columns of a garment


@final
@dataclass(frozen=True, kw_only=True)
class Clothes:
    """A garment.

    Attributes:
        garment: One of ``GARMENTS``.
        weave: What it is made of, a layer of ``weaves``.
        scale_mm: How large one repeat of the weave is.
        colour: Linear.
        second: Colour of its pattern.
        inner: Colour of what is worn below: the shirt under a suit.
        trim: Colour of tie or collar.
        depth: How deep the neckline is, 0..1.
        looseness_mm: Distance from the skin.
        has_tie: Under a shirt's or suit's collar.
        breadth: Of the shoulders, 1 is a man's.
        scarf: 0 none, otherwise how thick it is, mm.
        seed: Of folds.
    """

    garment: str
    weave: str
    scale_mm: float
    colour: Colour
    second: Colour
    inner: Colour
    trim: Colour
    depth: float
    looseness_mm: float
    has_tie: bool
    breadth: float
    scarf: float
    seed: int


def draw_clothes(rng: np.random.Generator, person: Person, pattern_share: float, scarf_share: float) -> Clothes:
    """Draws what a person wears: plain and muted mostly."""
    share = _SHARE["female" if person.femininity > 0.5 else "male"]
    garment = str(rng.choice(GARMENTS, p=np.array(share) / sum(share)))
    is_patterned = bool(rng.uniform() < pattern_share) and garment not in ("suit", "turtleneck", "zipped")
    weave = str(rng.choice(_PATTERNS if is_patterned else _PLAIN))
    if garment == "suit":
        weave = str(rng.choice(["jersey", "herringbone", "linen"]))
    colour = draw_cloth_colour(rng)
    second = draw_cloth_colour(rng) if is_patterned else tuple(round(0.75 * part, 4) for part in colour)
    inner = WHITE if rng.uniform() < 0.6 else draw_cloth_colour(rng)
    return Clothes(
        garment=garment,
        weave=weave,
        scale_mm=round(float(rng.uniform(50, 130) if is_patterned else rng.uniform(25, 50)), 1),
        colour=colour,
        second=second,  # type: ignore[arg-type]
        inner=inner,
        trim=draw_cloth_colour(rng),
        depth=round(float(rng.beta(1.5, 2.5)), 3),
        looseness_mm=round(float(rng.uniform(2.5, 9)), 2),
        has_tie=bool(rng.uniform() < (0.75 if garment == "suit" else 0.12) * (1 - person.femininity)),
        breadth=round(float(np.clip(rng.normal(1.0 - 0.12 * person.femininity, 0.05), 0.75, 1.15)), 3),
        scarf=round(float(rng.uniform(12, 24)), 1) if rng.uniform() < scarf_share else 0.0,
        seed=int(rng.integers(2**31)),
    )


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
