"""Draws eyes, teeth and tongue."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy import ndarray

from datagen.appearance.person import Person
from datagen.appearance.scene import Colour
from datagen.appearance.skin.skin_config import SkinConfig
from datagen.appearance.skin.skin_textures import IRISES
from datagen.random_streams import rounded, triple

# Linear colours of irises from the darkest to the lightest: outer part, and inner part around the pupil.
_IRISES = np.array(
    [
        [0.022, 0.012, 0.008, 0.026, 0.014, 0.008],
        [0.050, 0.022, 0.010, 0.066, 0.028, 0.011],
        [0.105, 0.048, 0.018, 0.140, 0.062, 0.020],
        [0.150, 0.095, 0.036, 0.190, 0.105, 0.034],
        [0.125, 0.120, 0.055, 0.190, 0.120, 0.040],
        [0.120, 0.150, 0.110, 0.190, 0.160, 0.085],
        [0.110, 0.170, 0.210, 0.150, 0.190, 0.200],
        [0.200, 0.270, 0.330, 0.250, 0.300, 0.330],
        [0.330, 0.370, 0.390, 0.360, 0.390, 0.390],
    ]
)


@final
@dataclass(frozen=True, kw_only=True)
class Eyes:
    """Both eyes. Colours are linear, 0..1."""

    left_inner: Colour  # iris of the subject's left eye, around the pupil
    left_outer: Colour  # the rest of that iris
    right_inner: Colour
    right_outer: Colour
    fibres: str  # one of `IRISES`
    pupil: float  # radius of the pupil over that of the iris
    limbal_ring: float  # how dark the rim of the iris is, 0..1
    iris_size: float  # sine of the angle between the eye's axis and the rim
    sclera: Colour
    veins: float
    redness: float  # 0..1


@final
@dataclass(frozen=True, kw_only=True)
class Mouth:
    """Teeth and tongue."""

    teeth: Colour  # linear colour
    gaps: float  # how dark the joints between the teeth are, 0..1
    missing: int  # which upper tooth is missing, counted from the middle, negative on the subject's right; 0 for none
    gold: int  # which one is gold, counted in the same way
    has_braces: bool  # brackets and a wire
    stain: float  # how dark the teeth are towards the gum
    tongue: Colour  # linear colour


def draw_eyes(rng: np.random.Generator, config: SkinConfig, person: Person) -> Eyes:
    """Draws a pair of eyes: brown, or any colour for light skin of European origin."""
    brown = rng.beta(1.2, 5.0) * 0.45
    lighter = rng.uniform(0.15, 1.0)
    is_light = rng.random() < person.caucasian * (1.15 - person.melanin)
    place = lighter if is_light else brown
    left = right = _iris(rng, place)
    is_odd, is_lens = rng.random() < config.odd_eyes_share, rng.random() < 0.5
    other = _iris(rng, float(rng.uniform()))
    lens = _rounded(rng.uniform(0.03, 0.6, size=3))
    if is_odd and is_lens:
        left = right = (lens, lens)
    elif is_odd:
        right = other
    yellow = rng.uniform(0, 0.10) + 0.05 * person.melanin + 0.0006 * max(person.age_years - 30, 0)
    white = rng.uniform(0.55, 0.72) - 0.08 * person.melanin
    return Eyes(
        left_inner=left[0],
        left_outer=left[1],
        right_inner=right[0],
        right_outer=right[1],
        fibres=IRISES[int(rng.integers(len(IRISES)))],
        pupil=rounded(rng.uniform(*config.pupil)),
        limbal_ring=rounded(rng.uniform(0.2, 0.9) * (1 - 0.005 * (person.age_years - 16))),
        iris_size=rounded(rng.uniform(0.372, 0.402), 4),
        sclera=_rounded(white * np.array([1.0, 0.965 - 0.5 * yellow, 0.93 - 1.5 * yellow])),
        veins=rounded(rng.uniform(0.05, 0.6)),
        redness=rounded(rng.uniform(*config.redness) * rng.uniform()),
    )


def draw_mouth(rng: np.random.Generator, config: SkinConfig, person: Person) -> Mouth:
    """Draws teeth and tongue."""
    yellow = np.clip(rng.uniform(*config.yellow_teeth) + 0.003 * (person.age_years - 40), 0, 1)
    value = rng.uniform(0.6, 0.82) * (1 - 0.35 * yellow)
    has_gap, missing, gold = rng.random(3) < [config.gap_share, config.missing_tooth_share, config.gold_tooth_share]
    sides = rng.choice([-1, 1], size=2)
    braces = config.braces_share * (1.0 if person.age_years < 22 else 0.2)
    return Mouth(
        teeth=_rounded(value * np.array([1.0, 0.95 - 0.16 * yellow, 0.84 - 0.42 * yellow])),
        gaps=rounded(rng.uniform(0.5, 1.0) if has_gap else rng.uniform(0, 0.4)),
        missing=int(sides[0] * rng.integers(1, 5)) if missing else 0,
        gold=int(sides[1] * rng.integers(1, 5)) if gold else 0,
        has_braces=bool(rng.random() < braces),
        stain=rounded(rng.uniform(0, 0.45) * (0.3 + yellow)),
        tongue=_rounded(rng.uniform(0.85, 1.15) * np.array([0.36, 0.135, 0.125])),
    )


def _iris(rng: np.random.Generator, place: float) -> tuple[Colour, Colour]:
    """Draws the inner and outer colour of an iris, at a place on the scale from dark brown (0) to light grey (1)."""
    knots = np.linspace(0, 1, len(_IRISES))
    colours = np.exp(rng.normal(0, 0.18)) * np.array([np.interp(place, knots, ramp) for ramp in _IRISES.T])
    outer, inner = colours[:3], colours[3:]
    ring = rng.uniform(0, 1.3)
    return _rounded(outer + ring * (inner - outer)), _rounded(outer)


def _rounded(colour: ndarray) -> Colour:
    return triple(np.clip(colour, 0.004, 0.95))
