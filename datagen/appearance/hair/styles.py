"""Draws the hairdo of a person: one of ten modelled ones with variations, or none."""

from dataclasses import dataclass
from typing import final

import numpy as np

from datagen.appearance.hair.hair_config import HairConfig
from datagen.appearance.person import Person
from datagen.random_streams import rounded, weighted_choice


@final
@dataclass(frozen=True, kw_only=True)
class Style:
    """A modelled hairdo."""

    female: float  # weight among women
    male: float  # weight among men
    african: float = 1.0  # factor on the weight for African people
    is_long: bool = False  # whether it hangs below the ears, so that its length can vary
    covers: bool = False  # whether it hangs over cheeks, shoulders and forehead
    cap: bool = False  # whether it has gaps at the crown, which a second style fills
    scalp_density: float = 0.7  # density of the hair painted on the scalp, 0..1


# Everybody can have every style.
STYLES = {
    "afro01": Style(female=0.5, male=0.35, african=6.0),
    "bob01": Style(female=1.3, male=0.12, african=0.5, is_long=True, covers=True),
    "bob02": Style(female=1.3, male=0.2, african=0.5, is_long=True, covers=True),
    "braid01": Style(female=1.0, male=0.03, african=1.5, is_long=True, scalp_density=0.85),
    "long01": Style(female=1.4, male=0.25, african=0.5, is_long=True, covers=True),
    "ponytail01": Style(female=1.5, male=0.12, is_long=True, cap=True, scalp_density=0.85),
    "short01": Style(female=0.4, male=1.2, african=0.5),
    "short02": Style(female=0.5, male=1.6),
    "short03": Style(female=0.4, male=1.6),
    "short04": Style(female=0.4, male=1.6, african=1.3),
}
CAPS = ("short03", "short04")
# Styles without a mesh: weight, and smallest and largest density of the hair painted on the scalp.
WITHOUT_MESH = {"bald": (0.3, (0.0, 0.06)), "shaved": (0.35, (0.15, 0.45)), "cropped": (0.35, (0.6, 0.95))}
UNCUT_MM = -1000.0


@final
@dataclass(frozen=True, kw_only=True)
class Hairdo:
    """A hairdo as it was drawn for one person."""

    style: str  # a key of `STYLES` or of `WITHOUT_MESH`
    cap: str  # a second style below the first, or empty
    is_mirrored: bool
    length: float  # factor on the length below the ears
    cut_mm: float  # height in the model frame at which it is cut off
    volume: float  # factor on the distance from the scalp
    aside: float  # how far strands over forehead and cheeks are combed aside: 0 as modelled, 1 completely
    sway_mm: float  # shift of tips 10 cm from the scalp towards the subject's left
    density: float  # density of the hair; 1 as modelled
    thinning: float  # how thin hair is at the crown, 0..1
    scalp_density: float  # density of the hair painted on the scalp, 0..1, for `skin_scalp_hair`


def draw_hairdo(rng: np.random.Generator, config: HairConfig, person: Person) -> Hairdo:
    """Draws a hairdo."""
    style, scalp_density = _draw_style(rng, config, person)
    modelled = STYLES.get(style, Style(female=0, male=0))
    is_capped = modelled.cap or (not modelled.covers and rng.random() < config.cap_share)
    hangs = rng.random() < config.over_face_share
    thinning = _draw_thinning(rng, config, person) if style in STYLES else 0.0
    is_cut = modelled.is_long and rng.random() < config.cut_share
    return Hairdo(
        style=style,
        cap=str(rng.choice(CAPS)) if is_capped and style in STYLES else "",
        is_mirrored=bool(rng.random() < config.mirrored_share),
        length=rounded(rng.uniform(*config.length) if modelled.is_long else 1.0),
        cut_mm=rounded(rng.uniform(-200, -30) if is_cut else UNCUT_MM, 1),
        volume=rounded(rng.uniform(*config.volume)),
        aside=rounded(rng.uniform(0, 0.3) if hangs else rng.uniform(0.7, 1)),
        sway_mm=rounded(rng.normal(0, config.sway_mm), 2),
        density=rounded(rng.uniform(*config.density)),
        thinning=round(thinning, 3),
        scalp_density=round(scalp_density * (1 - 0.8 * thinning), 3),
    )


def _draw_style(rng: np.random.Generator, config: HairConfig, person: Person) -> tuple[str, float]:
    male = 1 - person.femininity
    if rng.random() < config.no_mesh_share * (male + person.femininity / 3):
        style = weighted_choice(rng, {name: weight for name, (weight, _) in WITHOUT_MESH.items()})
        return style, float(rng.uniform(*WITHOUT_MESH[style][1]))
    style = weighted_choice(rng, {name: _weight(style, config, person) for name, style in STYLES.items()})
    return style, float(np.clip(STYLES[style].scalp_density + rng.normal(0, 0.1), 0, 1))


def _weight(style: Style, config: HairConfig, person: Person) -> float:
    by_sex = style.male + person.femininity * (style.female - style.male)
    by_origin = 1 + person.african * (style.african - 1)
    # Old people have long hair less often.
    by_age = 1 - 0.6 * min(max((person.age_years - 50) / 30, 0.0), 1.0) * style.is_long
    return float(by_sex * by_origin * by_age * (config.covering_factor if style.covers else 1))


def _draw_thinning(rng: np.random.Generator, config: HairConfig, person: Person) -> float:
    by_age = np.clip((person.age_years - 20) / 40, 0, 1.4)
    share = config.thinning_share * by_age * (1 - 0.75 * person.femininity)
    return float(rng.beta(1.5, 1.5)) if rng.random() < share else 0.0
