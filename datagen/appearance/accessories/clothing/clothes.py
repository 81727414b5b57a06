"""Draws clothes."""

from dataclasses import dataclass
from typing import final

import numpy as np

from datagen.appearance.accessories.materials import WHITE, draw_cloth_colour
from datagen.appearance.person import Person
from datagen.appearance.scene import Colour
from datagen.random_streams import rounded, triple, weighted_choice

GARMENTS = ("t-shirt", "v-neck", "sweater", "shirt", "suit", "turtleneck", "hoodie", "zipped", "straps")
# Weights among men and women.
_MALE = (0.26, 0.07, 0.12, 0.20, 0.13, 0.04, 0.10, 0.08, 0.0)
_FEMALE = (0.20, 0.15, 0.12, 0.13, 0.06, 0.08, 0.08, 0.06, 0.12)
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


@final
@dataclass(frozen=True, kw_only=True)
class Clothes:
    """A garment."""

    garment: str  # one of `GARMENTS`
    weave: str  # a layer of `weaves`
    scale_mm: float  # size of one repeat of the weave
    colour: Colour  # linear
    second: Colour  # linear colour of the pattern
    inner: Colour  # linear colour of the shirt under a suit
    trim: Colour  # linear colour of the tie or collar
    depth: float  # depth of the neckline, 0..1
    looseness_mm: float  # distance from the skin
    has_tie: bool  # whether there is a tie, with a shirt or a suit
    breadth: float  # breadth of the shoulders; 1 is a man's
    scarf: float  # thickness of the scarf, mm; 0 for none
    seed: int  # for the folds


def draw_clothes(rng: np.random.Generator, person: Person, pattern_share: float, scarf_share: float) -> Clothes:
    """Draws clothes, mostly plain and muted ones."""
    weights = _FEMALE if person.femininity > 0.5 else _MALE
    garment = weighted_choice(rng, dict(zip(GARMENTS, weights, strict=True)))
    is_patterned = bool(rng.uniform() < pattern_share) and garment not in ("suit", "turtleneck", "zipped")
    weave = str(rng.choice(_PATTERNS if is_patterned else _PLAIN))
    if garment == "suit":
        weave = str(rng.choice(["jersey", "herringbone", "linen"]))
    colour = draw_cloth_colour(rng)
    second = draw_cloth_colour(rng) if is_patterned else triple(0.75 * part for part in colour)
    inner = WHITE if rng.uniform() < 0.6 else draw_cloth_colour(rng)
    return Clothes(
        garment=garment,
        weave=weave,
        scale_mm=rounded(rng.uniform(50, 130) if is_patterned else rng.uniform(25, 50), 1),
        colour=colour,
        second=second,
        inner=inner,
        trim=draw_cloth_colour(rng),
        depth=rounded(rng.beta(1.5, 2.5)),
        looseness_mm=rounded(rng.uniform(2.5, 9), 2),
        has_tie=bool(rng.uniform() < (0.75 if garment == "suit" else 0.12) * (1 - person.femininity)),
        breadth=rounded(np.clip(rng.normal(1.0 - 0.12 * person.femininity, 0.05), 0.75, 1.15)),
        scarf=rounded(rng.uniform(12, 24), 1) if rng.uniform() < scarf_share else 0.0,
        seed=int(rng.integers(2**31)),
    )
