"""Draws hats, headscarves and hoods."""

from dataclasses import dataclass
from typing import final

import numpy as np

from datagen.appearance.accessories.materials import GOLD, draw_cloth_colour, draw_tint
from datagen.appearance.person import Person
from datagen.appearance.scene import Colour
from datagen.random_streams import rounded, weighted_choice

WRAPS = ("hood", "headscarf")
# Weights among men and women with a hat.
_WEIGHTS = {
    "cap": (0.36, 0.16),
    "beanie": (0.2, 0.2),
    "brimmed": (0.09, 0.16),
    "fedora": (0.05, 0.04),
    "helmet": (0.08, 0.04),
    "turban": (0.06, 0.01),
    "hood": (0.08, 0.07),
    "headscarf": (0.0, 0.2),
    "bandana": (0.04, 0.04),
    "headband": (0.02, 0.05),
    "crown": (0.01, 0.02),
    "party": (0.01, 0.01),
}
HATS = tuple(_WEIGHTS)


@final
@dataclass(frozen=True, kw_only=True)
class Headwear:
    """Headwear."""

    kind: str  # one of `HATS`
    weave: str
    colour: Colour  # linear
    second: Colour  # linear colour of the pattern, ribbon or band
    size: float  # size of peak, brim or fold, or the height, by kind; 0..1
    lift_deg: float  # elevation of the rim above the usual one
    turn_deg: float  # rotation about the vertical axis; 180 is a cap worn backwards
    tilt_deg: float  # rotation to one side
    has_extra: bool  # whether it has a pompom, a logo or a visor, by kind
    seed: int  # for the folds


def draw_headwear(rng: np.random.Generator, person: Person) -> Headwear:
    """Draws a hat."""
    kind = weighted_choice(rng, {kind: weights[person.femininity > 0.5] for kind, weights in _WEIGHTS.items()})
    weaves = {
        "cap": ("jersey", "denim", "linen", "camouflage"),
        "beanie": ("knit", "rib"),
        "brimmed": ("fleece", "straw", "leather", "linen"),
        "turban": ("jersey", "linen", "stripes_across"),
        "hood": ("jersey", "fleece"),
        "headscarf": ("jersey", "linen", "flowers", "jersey"),
        "bandana": ("flowers", "dots", "jersey"),
        "headband": ("rib", "jersey"),
    }.get(kind, ("jersey",))
    is_backwards = kind == "cap" and rng.uniform() < 0.18
    bright = rng.uniform() < 0.6 and kind in ("helmet", "party")
    return Headwear(
        kind=kind,
        weave=str(rng.choice(weaves)),
        colour=GOLD if kind == "crown" else draw_tint(rng, 0.7, 0.8) if bright else draw_cloth_colour(rng),
        second=draw_cloth_colour(rng),
        size=rounded(rng.uniform()),
        lift_deg=rounded(rng.normal(0, 3), 2),
        turn_deg=rounded(180 * is_backwards + rng.normal(0, 4), 2),
        tilt_deg=rounded(rng.normal(0, 3), 2),
        has_extra=bool(rng.uniform() < 0.45),
        seed=int(rng.integers(2**31)),
    )
