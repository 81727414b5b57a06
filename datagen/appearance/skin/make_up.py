"""Make-up and painted faces."""

import colorsys
from dataclasses import dataclass
from typing import final

import numpy as np

from datagen.appearance.person import Person
from datagen.appearance.scene import Colour
from datagen.appearance.skin.skin_config import SkinConfig
from datagen.random_streams import rounded, triple

FACE_PAINTS = ("none", "stripes", "half", "full", "band", "cheek")


@final
@dataclass(frozen=True, kw_only=True)
class MakeUp:
    """Make-up and face paint. Colours are linear, 0..1; a strength of 0 means none."""

    lipstick: Colour = (0.0, 0.0, 0.0)
    lipstick_strength: float = 0.0
    lip_gloss: float = 0.0  # 0..1
    eye_shadow: Colour = (0.0, 0.0, 0.0)
    eye_shadow_strength: float = 0.0
    eyeliner: float = 0.0  # how black the edges of the lids are
    blusher: Colour = (0.0, 0.0, 0.0)
    blusher_strength: float = 0.0
    foundation: float = 0.0  # how much it evens out the skin, 0..1
    face_paint: str = "none"  # one of `FACE_PAINTS`
    # the second colour is used around the eyes of fully painted faces
    face_paint_colours: tuple[Colour, Colour] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    face_paint_strength: float = 0.0


def draw_make_up(rng: np.random.Generator, config: SkinConfig, person: Person) -> MakeUp:
    """Draws the make-up of one person, and rarely face paint."""
    share = config.make_up_share * (1.0 / 12 + 11.0 / 12 * person.femininity**2)
    is_worn, is_vivid = rng.random() < share, rng.random() < config.vivid_make_up_share
    worn = _draw_worn(rng, person, is_vivid)
    is_painted = rng.random() < config.face_paint_share
    pattern = FACE_PAINTS[int(rng.integers(1, len(FACE_PAINTS)))]
    paints = (_vivid(rng), _vivid(rng))
    opacity = rounded(rng.uniform(0.6, 0.95))
    painted = {"face_paint": pattern, "face_paint_colours": paints, "face_paint_strength": opacity}
    return MakeUp(**(worn if is_worn else {}), **(painted if is_painted else {}))  # type: ignore[arg-type]


def _draw_worn(rng: np.random.Generator, person: Person, is_vivid: bool) -> dict[str, object]:
    """Draws each product independently, since many people wear only one or two."""
    wears = rng.random(5) < [0.7, 0.45, 0.6, 0.5, 0.6]
    light = 1.0 - 0.7 * person.melanin
    lipstick = (
        _vivid(rng) if is_vivid else _rgb(rng.uniform(-0.09, 0.045), rng.uniform(0.45, 0.95), rng.uniform(0.3, 0.8))
    )
    shadow = _vivid(rng) if is_vivid else _rgb(rng.uniform(-0.08, 0.11), rng.uniform(0.1, 0.6), rng.uniform(0.15, 0.6))
    blush = _rgb(rng.uniform(-0.04, 0.04), rng.uniform(0.45, 0.7), 0.25 + 0.65 * light)
    strength = rng.uniform(0.15, 1.0, size=5) * wears
    return {
        "lipstick": lipstick,
        "lipstick_strength": rounded(0.9 * strength[0]),
        "lip_gloss": rounded(rng.uniform(0, 1) * wears[0]),
        "eye_shadow": shadow,
        "eye_shadow_strength": rounded(0.75 * strength[1]),
        "eyeliner": rounded(strength[2]),
        "blusher": blush,
        "blusher_strength": rounded(0.4 * strength[3]),
        "foundation": rounded(0.8 * strength[4]),
    }


def _vivid(rng: np.random.Generator) -> Colour:
    """Draws any colour, including black and white."""
    return _rgb(rng.uniform(), rng.choice([0.0, 0.6, 0.95], p=[0.25, 0.25, 0.5]), rng.choice([0.08, 0.6, 0.95]))


def _rgb(hue: float, saturation: float, value: float) -> Colour:
    return triple(channel**2.2 for channel in colorsys.hsv_to_rgb(float(hue) % 1.0, float(saturation), float(value)))
