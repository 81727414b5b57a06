"""Draws glasses, sunglasses and goggles."""

from dataclasses import dataclass
from typing import final

import numpy as np

from datagen.appearance.accessories.materials import BLACK, GOLD, SILVER, draw_tint
from datagen.appearance.scene import Colour
from datagen.random_streams import rounded

SHAPES = ("round", "rectangle", "aviator", "cat-eye", "square", "oval")


@final
@dataclass(frozen=True, kw_only=True)
class Glasses:
    """A pair of glasses."""

    shape: str  # one of `SHAPES`
    rim: str  # full, half, none or goggles
    width_mm: float  # of one lens
    height_mm: float  # of one lens
    bridge_mm: float  # between the lenses
    thickness_mm: float  # half the width of the rim
    is_metal: bool  # otherwise plastic
    colour: Colour  # of the frame, linear
    lens_colour: Colour  # linear
    lens_alpha: float  # 0 is clear, 1 opaque
    mirror: float  # share of light that a coating reflects; 0 for bare glass
    gradient: float  # how much darker the lenses are at the top than at the bottom
    slip_mm: float  # distance down the nose
    lift: float  # 0 is on the nose, 1 pushed up into the hair
    tilt_deg: float  # forward tilt of the top of the lenses
    skew_deg: float  # rotation in the plane of the lenses


def draw_glasses(rng: np.random.Generator, *, is_dark: bool, goggle_share: float = 0.0) -> Glasses:
    """Draws glasses or sunglasses."""
    if rng.uniform() < goggle_share:
        return _draw_goggles(rng)
    shape = str(rng.choice(SHAPES))
    rim = str(rng.choice(["full", "half", "none"], p=[0.74, 0.14, 0.12]))
    is_metal = bool(rng.uniform() < (0.75 if shape in ("aviator", "round") or rim != "full" else 0.3))
    width = float(rng.uniform(44, 56) + 5 * is_dark)
    aspect = {"round": 0.95, "rectangle": 0.62, "aviator": 0.86, "cat-eye": 0.72, "square": 0.82, "oval": 0.68}[shape]
    is_mirrored = is_dark and rng.uniform() < 0.25
    is_tinted = not is_dark and rng.uniform() < 0.08
    alpha = rng.uniform(0.80, 0.96) if is_dark else rng.uniform(0.2, 0.5) if is_tinted else rng.uniform(0.0, 0.05)
    tint = draw_tint(rng, 0.8 if is_mirrored or is_tinted else rng.uniform(0, 0.5), 0.9 if is_mirrored else 0.18)
    place = rng.choice(["nose", "low", "hair"], p=[0.88, 0.08, 0.04] if not is_dark else [0.84, 0.04, 0.12])
    return Glasses(
        shape=shape,
        rim=rim,
        width_mm=round(width, 2),
        height_mm=rounded(width * aspect * rng.uniform(0.9, 1.1), 2),
        bridge_mm=rounded(rng.uniform(15, 21), 2),
        thickness_mm=rounded(rng.uniform(0.5, 0.9) if is_metal else rng.gamma(4, 0.4) + 0.8, 2),
        is_metal=is_metal,
        colour=_frame_colour(rng, is_metal),
        lens_colour=tint,
        lens_alpha=rounded(alpha),
        mirror=rounded(rng.uniform(0.3, 0.8)) if is_mirrored else 0.0,
        gradient=rounded(rng.uniform(0, 0.35)) if is_dark or is_tinted else 0.0,
        slip_mm=rounded(rng.uniform(10, 20) if place == "low" else rng.uniform(0, 4), 2),
        lift=rounded(rng.uniform(0.85, 1.0)) if place == "hair" else 0.0,
        tilt_deg=rounded(rng.uniform(3, 10), 2),
        skew_deg=rounded(rng.normal(0, 1.0), 2),
    )


def _draw_goggles(rng: np.random.Generator) -> Glasses:
    """Draws swimming goggles (small) or ski goggles (large)."""
    is_ski = bool(rng.uniform() < 0.5)
    return Glasses(
        shape="oval" if not is_ski else "square",
        rim="goggles",
        width_mm=rounded(rng.uniform(70, 76) if is_ski else rng.uniform(48, 54), 2),
        height_mm=rounded(rng.uniform(66, 74) if is_ski else rng.uniform(34, 40), 2),
        bridge_mm=2.0 if is_ski else 14.0,
        thickness_mm=5.0 if is_ski else 3.5,
        is_metal=False,
        colour=draw_tint(rng, float(rng.uniform(0, 0.8)), float(rng.uniform(0.1, 0.9))),
        lens_colour=draw_tint(rng, 0.7, 0.5),
        lens_alpha=rounded(rng.uniform(0.3, 0.95)),
        mirror=rounded(rng.uniform(0.1, 0.7)),
        gradient=0.0,
        slip_mm=0.0,
        lift=0.9 if rng.uniform() < 0.2 else 0.0,
        tilt_deg=3.0,
        skew_deg=0.0,
    )


def _frame_colour(rng: np.random.Generator, is_metal: bool) -> Colour:
    if is_metal:
        return (GOLD, SILVER, (0.05, 0.05, 0.055))[int(rng.choice(3, p=[0.3, 0.35, 0.35]))]
    kind = rng.uniform()
    if kind < 0.5:
        return BLACK
    if kind < 0.75:
        shade = float(rng.uniform(0.04, 0.16))
        return round(shade, 4), round(shade * 0.45, 4), round(shade * 0.2, 4)  # tortoiseshell
    return draw_tint(rng, float(rng.uniform(0.1, 0.7)), float(rng.uniform(0.2, 0.9)))
