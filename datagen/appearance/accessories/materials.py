"""Materials of accessories, and random colours for them, in linear light."""

import colorsys
from typing import Any

import numpy as np

from datagen.appearance.accessories.weaves import WEAVES, layer_of
from datagen.appearance.scene import Colour, Material
from datagen.random_streams import triple
from pix2face.files.images import srgb_to_linear

BLACK: Colour = (0.012, 0.012, 0.014)
WHITE: Colour = (0.78, 0.78, 0.76)
GOLD: Colour = (0.72, 0.48, 0.18)
SILVER: Colour = (0.62, 0.62, 0.62)


def draw_cloth_colour(rng: np.random.Generator) -> Colour:
    """Draws a colour of clothes: mostly black, white, grey, navy or dull, sometimes bright."""
    kind = rng.choice(["dark", "light", "grey", "navy", "dull", "bright"], p=[0.22, 0.18, 0.14, 0.12, 0.24, 0.10])
    hue, value = rng.uniform(), rng.uniform()
    saturation, brightness = {
        "dark": (0.15 * value, 0.10 + 0.12 * value),
        "light": (0.08 * value, 0.80 + 0.15 * value),
        "grey": (0.05, 0.30 + 0.40 * value),
        "navy": (0.50 + 0.2 * value, 0.20 + 0.15 * value),
        "dull": (0.15 + 0.35 * value, 0.35 + 0.35 * rng.uniform()),
        "bright": (0.55 + 0.35 * value, 0.50 + 0.35 * rng.uniform()),
    }[str(kind)]
    hue = 0.58 + 0.08 * hue if kind == "navy" else hue
    return linear_colour(colorsys.hsv_to_rgb(hue, saturation, brightness))


def draw_tint(rng: np.random.Generator, saturation: float, brightness: float) -> Colour:
    """Draws a colour of any hue, with the given saturation and brightness (both 0..1, sRGB)."""
    return linear_colour(colorsys.hsv_to_rgb(float(rng.uniform()), saturation, brightness))


def linear_colour(srgb: tuple[float, float, float]) -> Colour:
    """Converts sRGB (0..1) to linear light, rounded as stored."""
    return triple(srgb_to_linear(np.array(srgb, dtype=np.float64)))


def cloth(weave: str, colour: Colour, second: Colour = (0.0, 0.0, 0.0), roughness: float = 0.85) -> Material:
    """Makes a weave in two colours."""
    return _woven(weave, colour, roughness, reflectance=0.03, numbers=(*second, 0.0))


def cut_out(weave: str, colour: Colour, second: Colour, roughness: float) -> Material:
    """Makes a weave with holes, such as lace or leaves."""
    return _woven(weave, colour, roughness, numbers=(*second, 0.0), is_blended=True)


def skin_material(skin_rgb: Colour) -> Material:
    """Makes the skin of hands, neck and shoulders."""
    return _woven("skin", skin_rgb, 0.55, reflectance=0.028, numbers=(*skin_rgb, 1.0))


def _woven(weave: str, colour: Colour, roughness: float, **more: Any) -> Material:
    return Material(kind="object", texture=WEAVES, layer=layer_of(weave), colour=colour, roughness=roughness, **more)


def smooth(colour: Colour, roughness: float, reflectance: float = 0.04) -> Material:
    """Makes plastic, metal or enamel of one colour."""
    return Material(kind="object", colour=colour, roughness=roughness, reflectance=reflectance, numbers=(*colour, 0.0))
