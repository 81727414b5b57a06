"""Which hats people wear, and how."""

from dataclasses import dataclass
from typing import final

import numpy as np

from datagen.appearance.accessories.colours import GOLD, Colour, draw_cloth_colour, draw_tint
from datagen.appearance.person import Person

HATS = ("cap", "beanie", "brimmed", "helmet", "turban", "hood", "headscarf", "bandana", "headband", "crown", "party")
WRAPS = ("hood", "headscarf")
_SHARES = {
    "male": (0.36, 0.20, 0.14, 0.08, 0.06, 0.08, 0.0, 0.04, 0.02, 0.01, 0.01),
    "female": (0.16, 0.20, 0.20, 0.04, 0.01, 0.07, 0.20, 0.04, 0.05, 0.02, 0.01),
}


@final
@dataclass(frozen=True, kw_only=True)
class Headwear:
    """Something on a head.

    Attributes:
        kind: One of ``HATS``.
        weave: Of its cloth.
        colour: Linear.
        second: Of pattern, ribbon or band, linear.
        size: Of what varies most (peak, brim, fold, height), 0..1.
        lift_deg: How far up its rim is pushed.
        turn_deg: About the vertical axis: 180 a cap worn backwards.
        tilt_deg: To one side.
        has_extra: Pompom, logo, visor, knot: what the kind has.
        seed: Of folds.
    """

    kind: str
    weave: str
    colour: Colour
    second: Colour
    size: float
    lift_deg: float
    turn_deg: float
    tilt_deg: float
    has_extra: bool
    seed: int


def draw_headwear(rng: np.random.Generator, person: Person) -> Headwear:
    """Draws a hat."""
    share = np.array(_SHARES["female" if person.femininity > 0.5 else "male"])
    kind = str(rng.choice(HATS, p=share / share.sum()))
    weaves = {
        "cap": ("jersey", "denim", "linen", "camouflage"),
        "beanie": ("knit", "rib"),
        "brimmed": ("fleece", "straw", "leather", "linen"),
        "helmet": ("jersey",),
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
        size=round(float(rng.uniform()), 3),
        lift_deg=round(float(rng.normal(0, 3)), 2),
        turn_deg=round(float(180 * is_backwards + rng.normal(0, 4)), 2),
        tilt_deg=round(float(rng.normal(0, 3)), 2),
        has_extra=bool(rng.uniform() < 0.45),
        seed=int(rng.integers(2**31)),
    )
