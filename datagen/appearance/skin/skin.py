"""Draws the skin of one person: colour, wrinkles, marks, make-up, eyes and mouth."""

from dataclasses import dataclass
from typing import final

import numpy as np

from datagen.appearance.person import Person
from datagen.appearance.scene import Colour
from datagen.appearance.skin.eyes import Eyes, Mouth, draw_eyes, draw_mouth
from datagen.appearance.skin.make_up import MakeUp, draw_make_up
from datagen.appearance.skin.marks import Mark, draw_marks
from datagen.appearance.skin.skin_config import SkinConfig
from datagen.appearance.skin.skin_textures import AGES, SKINS
from datagen.random_streams import rounded, triple

MIDDLE_MELANIN = 0.43  # centre of the distribution over all people
# Melanin beyond these values is compressed, so that it is not clipped at the ends of the scale.
RARE_BELOW, RARE_ABOVE = 0.15, 0.78


@final
@dataclass(frozen=True, kw_only=True)
class Skin:
    """The skin of one person."""

    melanin: float  # 0 is the lightest skin, 1 the darkest; linear in lightness
    haemoglobin: float  # of skin at rest; 0.16 is usual
    flush: float  # further haemoglobin of cheeks, nose and ears
    under_eye: float  # strength of the circles under the eyes
    textures: tuple[str, str, str]  # three of `SKINS` that are blended
    texture_weights: tuple[float, float, float]  # of these three; they sum to 1
    texture_strength: float  # 0 none, 1 as photographed
    blotches: tuple[float, float]  # relative unevenness of melanin, and of blood
    noise_offset: tuple[float, float]  # offset in the tile of noise
    freckles: tuple[float, float]  # how many there are, 0..1, and how dark they are
    age_spots: float  # how dark they are
    vitiligo: bool  # white patches
    tan: float  # how much darker skin in the sun is
    # wrinkles of the face at rest, 0..1: forehead, between the brows, around the eyes, around the mouth, lips
    wrinkles: tuple[float, float, float, float, float]
    expression_folds: float  # factor on the folds that expressions make
    pores: float  # how coarse the surface is
    oil: float
    roughness: float  # of dry skin
    marks: tuple[Mark, ...]  # moles, acne, scars
    shaved_shadow: float  # how dark the shaved beard area is
    stubble: float  # how dense stubble is, 0..1
    hair_colour: Colour  # linear colour of stubble, painted brows and cropped hair, unless the hair has another
    brow_strength: float  # how strong painted brows are
    hairline: float  # how far the hair line recedes, 0..1
    make_up: MakeUp
    eyes: Eyes
    mouth: Mouth


def draw_skin(rng: np.random.Generator, config: SkinConfig, person: Person) -> Skin:
    """Draws the skin of a person."""
    config.check()
    melanin = _draw_melanin(rng, config, person)
    textures, weights = _draw_textures(rng, person)
    age = np.clip((person.age_years - 20) / 65, 0, 1)
    flush = rng.uniform(*config.flush) * (rng.uniform(2, 4) if rng.random() < config.sunburn_share else 1.0)
    shaved_shadow, stubble = _draw_beard(rng, config, person)
    return Skin(
        melanin=round(melanin, 4),
        haemoglobin=rounded(rng.uniform(*config.haemoglobin), 4),
        flush=rounded(min(flush, 0.7), 4),
        under_eye=rounded(rng.beta(1.5, 3) * (0.6 + 0.8 * age), 4),
        textures=textures,
        texture_weights=weights,
        texture_strength=rounded(rng.uniform(*config.texture), 4),
        blotches=(rounded(rng.uniform(*config.blotches), 4), rounded(2 * rng.uniform(*config.blotches), 4)),
        noise_offset=(rounded(rng.uniform(), 4), rounded(rng.uniform(), 4)),
        freckles=_draw_freckles(rng, config, melanin),
        age_spots=rounded(rng.uniform(0, 0.14) * np.clip((person.age_years - 45) / 30, 0, 1), 4),
        vitiligo=bool(rng.random() < config.vitiligo_share),
        tan=rounded(rng.uniform(0.25, 0.6) if rng.random() < config.tan_share else rng.uniform(0, 0.15), 4),
        wrinkles=_draw_wrinkles(rng, config, float(age)),
        expression_folds=rounded(config.expression_folds * rng.uniform(0.5, 1.2) * (0.6 + 0.8 * age), 4),
        pores=rounded(rng.uniform(0.1, 0.8) + 0.3 * age, 4),
        oil=rounded(rng.uniform(*config.oil), 4),
        roughness=rounded(rng.uniform(*config.roughness), 4),
        marks=draw_marks(rng, config, person),
        shaved_shadow=shaved_shadow,
        stubble=stubble,
        hair_colour=_draw_hair_colour(rng, person, melanin),
        brow_strength=rounded(rng.uniform(0.35, 0.75) * (1.05 - 0.25 * person.femininity), 4),
        hairline=rounded(rng.uniform(0, 0.25) + 0.6 * float(age) * (1 - person.femininity) * rng.uniform(), 4),
        make_up=draw_make_up(rng, config, person),
        eyes=draw_eyes(rng, config, person),
        mouth=draw_mouth(rng, config, person),
    )


def _draw_melanin(rng: np.random.Generator, config: SkinConfig, person: Person) -> float:
    wanted = MIDDLE_MELANIN + config.melanin_contrast * (person.melanin - MIDDLE_MELANIN)
    wanted += rng.normal(0, config.melanin_spread)
    if wanted > RARE_ABOVE:
        room = 1 - RARE_ABOVE
        return float(RARE_ABOVE + room * (1 - np.exp(-(wanted - RARE_ABOVE) / room)))
    return float(max(wanted, RARE_BELOW * np.exp(min(wanted - RARE_BELOW, 0) / RARE_BELOW)))


def _draw_textures(rng: np.random.Generator, person: Person) -> tuple[tuple[str, str, str], tuple[float, float, float]]:
    """Draws three textures that are close to a person's age, sex and origin, and their weights."""
    position = np.clip((person.age_years - 25) / 25, 0, 2)
    of_age = np.maximum(1 - np.abs(position - np.arange(len(AGES))), 0) + 0.05
    of_origin = np.array([person.african, person.asian, person.caucasian]) + 0.04
    of_sex = np.array([person.femininity, 1 - person.femininity]) + 0.08
    weights = np.einsum("a,o,s->aos", of_age, of_origin, of_sex).reshape(-1) * np.exp(rng.normal(0, 0.7, len(SKINS)))
    best = np.argsort(-weights)[:3]
    share = weights[best] / weights[best].sum()
    first, second, third = (SKINS[k] for k in best)
    rest = round(1 - rounded(share[0]) - rounded(share[1]), 3)
    return (first, second, third), (rounded(share[0]), rounded(share[1]), max(rest, 0.0))


def _draw_wrinkles(
    rng: np.random.Generator, config: SkinConfig, age: float
) -> tuple[float, float, float, float, float]:
    """Draws wrinkles, which begin at about 30 years. All adults have the fold beside the nose."""
    of_age = config.wrinkles * max(age - 0.1, 0.0) ** 0.8 * rng.lognormal(-0.15, 0.35, size=5)
    start = np.array([0.02, 0.02, 0.05, 0.14, 0.0]) * rng.uniform(0.3, 1.5, size=5)
    values = np.clip(of_age * [0.8, 0.7, 0.9, 0.8, 0.7] + start, 0, 1.1)
    forehead, brows, eyes, mouth, lips = (rounded(value, 4) for value in values)
    return forehead, brows, eyes, mouth, lips


def _draw_beard(rng: np.random.Generator, config: SkinConfig, person: Person) -> tuple[float, float]:
    """Draws the strength of the shaved shadow and of stubble."""
    male = max(1 - 1.6 * person.femininity, 0.0) * float(np.clip((person.age_years - 15) / 7, 0, 1))
    shadow = rng.uniform(*config.shaved_shadow) * male
    stubble = rng.uniform(*config.stubble) if rng.random() < config.stubble_share * male else 0.0
    return rounded(shadow, 4), rounded(stubble, 4)


def _draw_freckles(rng: np.random.Generator, config: SkinConfig, melanin: float) -> tuple[float, float]:
    """Draws the number of freckles and how dark they are. Only light skin has them."""
    has_some = rng.random() < config.freckles_share * float(np.clip(1 - 2 * melanin, 0, 1))
    return (rounded(rng.uniform(0.2, 0.75), 4), rounded(rng.uniform(0.04, 0.16), 4)) if has_some else (0.0, 0.0)


def _draw_hair_colour(rng: np.random.Generator, person: Person, melanin: float) -> Colour:
    """Draws a colour from black to dark blond, which turns grey with age."""
    dark = rng.uniform(0.01, 0.05) if rng.random() < 0.3 + melanin else rng.uniform(0.04, 0.22)
    grey = float(np.clip((person.age_years - 45) / 40, 0, 1)) * rng.uniform()
    return triple((1 - grey) * dark * np.array([1.0, 0.68, 0.45]) + grey * np.array([0.38, 0.37, 0.35]))
