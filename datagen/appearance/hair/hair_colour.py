"""Draws the colour of hair from its two melanins, age and dyes."""

import colorsys
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy import ndarray

from datagen.appearance.hair.hair_config import HairConfig
from datagen.appearance.person import Person
from datagen.appearance.scene import Colour
from datagen.random_streams import rounded, triple

# Absorption of one unit of each pigment, for red, green and blue. Source: d'Eon et al. 2011, Table 1.
EUMELANIN, PHEOMELANIN = np.array([0.419, 0.697, 1.37]), np.array([0.187, 0.4, 1.05])
# Light crosses many fibres before it returns, so the logarithm of the colour is proportional to the square root of the
# absorption (Chiang et al. 2016). With this factor, 0.1 units are platinum and 8 black.
DEPTH, FLOOR = 2.6, 0.004
WHITE_HAIR = np.array([0.60, 0.585, 0.55])


@final
@dataclass(frozen=True, kw_only=True)
class HairColour:
    """The colours of a head's hair, linear, 0..1."""

    eumelanin: float  # brown and black pigment, 0.05 (platinum) to 9 (black)
    pheomelanin: float  # red pigment, 0 to 3
    base: Colour  # colour without grey
    tips: Colour  # colour of the ends
    tips_from_mm: float  # height in the model frame at which the colour of the ends begins
    tips_to_mm: float  # height at which it is complete
    highlight: Colour  # colour of highlighted strands
    highlight_share: float  # share of strands that are highlighted
    grey: Colour  # colour of grey strands
    grey_share: float  # share of strands that are grey
    root_darkness: float  # how dark the roots at the crown are, 0..1
    is_dyed: bool  # whether the colour is dyed
    roughness: float  # roughness of the strands


def melanin_to_linear(eumelanin: float, pheomelanin: float) -> ndarray:
    """Returns the linear colour of dense hair with these amounts of pigment."""
    absorption = eumelanin * EUMELANIN + pheomelanin * PHEOMELANIN
    return FLOOR + (1 - FLOOR) * np.exp(-DEPTH * np.sqrt(absorption))


def draw_hair_colour(rng: np.random.Generator, config: HairConfig, person: Person) -> HairColour:
    """Draws the colour of a person's hair."""
    natural = _natural_pigments(rng, person)
    kind = rng.random()
    is_vivid, is_dyed = kind < config.vivid_share, kind < config.vivid_share + config.dyed_share
    dyed = _any_pigments(rng) if is_dyed else natural
    own = melanin_to_linear(*natural)
    base = _vivid(rng) if is_vivid else melanin_to_linear(*dyed)
    lightened = rng.random() < config.highlights_share
    lighter = _between(base, melanin_to_linear(dyed[0] * 0.25, dyed[1] * 0.6), rng.uniform(0.4, 1))
    if is_vivid and rng.random() < 0.5:  # only a lock or the tips are coloured
        base, lighter, lightened = own, base, True
    has_tips = lightened and rng.random() < 0.5
    begins = rng.uniform(-60, 60)
    grey_share = 0.0 if is_dyed and rng.random() < 0.8 else _grey_share(rng, config, person)
    return HairColour(
        eumelanin=rounded(dyed[0]),
        pheomelanin=rounded(dyed[1]),
        base=_colour(base),
        tips=_colour(lighter if has_tips else _between(base, lighter, 0.25)),
        tips_from_mm=rounded(begins, 1),
        tips_to_mm=rounded(begins - rng.uniform(40, 120), 1),
        highlight=_colour(lighter),
        highlight_share=rounded(rng.uniform(0.2, 0.6) if lightened and not has_tips else 0.0),
        grey=_colour(WHITE_HAIR * rng.uniform(0.6, 1.05) * rng.normal(1, [0.01, 0.01, 0.03])),
        grey_share=round(grey_share, 3),
        root_darkness=rounded(rng.uniform(0.3, 1) if is_dyed or lightened else rng.uniform(0, 0.3)),
        is_dyed=bool(is_dyed),
        roughness=rounded(rng.uniform(0.3, 0.65)),
    )


def brow_colour(rng: np.random.Generator, config: HairConfig, hair: HairColour) -> Colour:
    """Draws the colour of the brows: similar to the hair, mostly darker, and never very light."""
    eumelanin, pheomelanin = hair.eumelanin, hair.pheomelanin
    if hair.is_dyed or rng.random() < config.dyed_brows_share:
        eumelanin, pheomelanin = _any_pigments(rng)
    eumelanin = max(eumelanin, 0.35) * np.exp(rng.normal(0.35, 0.35))
    base = melanin_to_linear(float(eumelanin), pheomelanin)
    return _colour(_between(base, np.array(hair.grey), 0.7 * hair.grey_share * rng.random()))


def _natural_pigments(rng: np.random.Generator, person: Person) -> tuple[float, float]:
    """Draws natural pigments: black hair, except for Caucasian people, one in twenty of whom has red hair."""
    if rng.random() > person.caucasian:
        return float(np.exp(rng.normal(np.log(5.5), 0.35))), float(rng.uniform(0, 0.5))
    if rng.random() < 0.05:
        return float(rng.uniform(0.05, 0.7)), float(rng.uniform(0.9, 2.8))
    # Darker skin goes with darker hair.
    middle = np.log(1.1) + 3.0 * (person.melanin - 0.22)
    return float(np.clip(np.exp(rng.normal(middle, 0.85)), 0.06, 9)), float(rng.gamma(1.5, 0.2))


def _any_pigments(rng: np.random.Generator) -> tuple[float, float]:
    return float(np.exp(rng.uniform(np.log(0.05), np.log(8)))), float(rng.choice([0.1, rng.uniform(0.3, 2.5)]))


def _vivid(rng: np.random.Generator) -> ndarray:
    hue = rng.choice((0.58, 0.9, 0.4, 0.78, 0.99, 0.5)) + rng.normal(0, 0.02)
    rgb = np.array(colorsys.hsv_to_rgb(hue % 1, rng.uniform(0.35, 0.9), rng.uniform(0.35, 0.9)))
    return rgb**2.2


def _grey_share(rng: np.random.Generator, config: HairConfig, person: Person) -> float:
    half_grey_at = config.grey_age_years + rng.normal(0, 8)
    share = 1 / (1 + np.exp(-(person.age_years - half_grey_at) / 5))
    return float(share if share > 0.03 else 0.0)


def _between(a: ndarray, b: ndarray, share: float) -> ndarray:
    return a + share * (b - a)


def _colour(linear: ndarray) -> Colour:
    return triple(np.clip(linear, 0, 1))
