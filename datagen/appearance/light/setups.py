"""Arrangements of lamps, such as studios, windows, flashes and candles, each with ambient light.

Brightness is relative, since `light.py` scales it. Azimuth 0 is the camera's side, 90 the picture's right.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from datagen.appearance.light.harmonics import N_HARMONICS, point_light
from datagen.appearance.light.light_colour import lamp_colour
from datagen.appearance.light.light_sources import direction_of


@final
@dataclass(eq=False)
class Setup:
    """Lamps and ambient light of a scene that is being built, in the camera frame."""

    # direction, colour (irradiance / pi) and angular radius of each lamp, in any order and number
    lamps: list[tuple[Float64[ndarray, "3"], Float64[ndarray, "3"], float]] = field(default_factory=list)
    # spherical harmonics of all other light
    ambient: Float64[ndarray, "9 3"] = field(default_factory=lambda: np.zeros((N_HARMONICS, 3)))

    def lamp(self, azimuth_deg: float, elevation_deg: float, colour: ndarray, radius_rad: float) -> None:
        """Adds a lamp."""
        self.lamps.append((direction_of(azimuth_deg, elevation_deg), np.asarray(colour), float(radius_rad)))

    def glow(self, azimuth_deg: float, elevation_deg: float, colour: ndarray) -> None:
        """Adds ambient light from the side of a direction, which casts no shadow."""
        self.ambient += point_light(direction_of(azimuth_deg, elevation_deg), np.asarray(colour))

    def surround(self, colour: ndarray) -> None:
        """Adds the same light from all directions."""
        self.ambient[0] += colour


@final
@dataclass(frozen=True)
class Colours:
    """Draws colours of lamps, for a camera with a white balance for `camera_k`."""

    rng: np.random.Generator
    lowest_k: float
    highest_k: float
    camera_k: float

    def of(self, temperature_k: float) -> Float64[ndarray, "3"]:
        """Returns the colour of a lamp, whose temperature is clipped to the range."""
        return lamp_colour(float(np.clip(temperature_k, self.lowest_k, self.highest_k)), self.camera_k)

    def any(self) -> Float64[ndarray, "3"]:
        """Draws the colour of a lamp, with a temperature that is uniform in its inverse, as the eye perceives it."""
        return self.of(1 / self.rng.uniform(1 / self.highest_k, 1 / self.lowest_k))

    def neon(self) -> Float64[ndarray, "3"]:
        """Draws a saturated colour with a luminance of about 1."""
        hue = self.rng.uniform(0, 3)
        rgb = np.clip(2 - np.abs((hue + np.array([0.0, 2.0, 1.0])) % 3 - 1.5) * 2, 0.02, 1)
        return np.asarray(rgb / (rgb @ np.array([0.3, 0.5, 0.2])))


def draw_setup(rng: np.random.Generator, colours: Colours, harsh_share: float) -> tuple[str, Setup]:
    """Draws one of the arrangements."""
    table = HARSH_SETUPS if rng.uniform() < harsh_share else GENTLE_SETUPS
    name = sorted(table)[int(rng.integers(len(table)))]
    return name, build_setup(name, rng, colours)


def build_setup(name: str, rng: np.random.Generator, colours: Colours) -> Setup:
    """Draws the angles and strengths of one arrangement."""
    setup = Setup()
    {**GENTLE_SETUPS, **HARSH_SETUPS}[name](setup, rng, colours)
    return setup


def _side(rng: np.random.Generator) -> float:
    return -1.0 if rng.uniform() < 0.5 else 1.0


def _key_fill_rim(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    side, key, fill = _side(rng), colours.any(), rng.uniform(0.15, 0.6)
    setup.lamp(side * rng.uniform(25, 60), rng.uniform(10, 50), key, rng.uniform(0.08, 0.3))
    setup.glow(-side * rng.uniform(20, 70), rng.uniform(-10, 25), fill * colours.any())
    setup.lamp(-side * rng.uniform(120, 165), rng.uniform(10, 50), rng.uniform(0.3, 2.0) * colours.any(), 0.15)
    setup.surround(rng.uniform(0.03, 0.2) * key)


def _softboxes(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    tint = colours.any()
    for side in (-1, 1):
        setup.lamp(side * rng.uniform(30, 70), rng.uniform(0, 40), rng.uniform(0.4, 1) * tint, rng.uniform(0.25, 0.45))
    setup.surround(rng.uniform(0.05, 0.3) * tint)


def _flash_on_camera(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    setup.lamp(rng.normal(0, 4), rng.uniform(1, 10), colours.of(5800), 0.015)
    setup.surround(rng.uniform(0.01, 0.15) * colours.any())


def _ring_light(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    setup.lamp(rng.normal(0, 3), rng.normal(3, 4), colours.any(), rng.uniform(0.12, 0.3))
    setup.surround(rng.uniform(0.05, 0.35) * colours.any())


def _window(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    side = _side(rng)
    setup.lamp(side * rng.uniform(40, 100), rng.uniform(0, 30), colours.of(rng.uniform(5500, 8500)), 0.4)
    setup.surround(rng.uniform(0.06, 0.35) * colours.of(rng.uniform(3000, 6000)))


def _overcast(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    sky = colours.of(rng.uniform(6000, 8500))
    setup.surround(rng.uniform(0.25, 0.5) * sky)
    setup.glow(rng.uniform(-180, 180), rng.uniform(60, 90), sky)


def _office(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    tint = colours.of(rng.uniform(3500, 5500))
    setup.lamp(rng.uniform(-60, 60), rng.uniform(45, 75), tint, 0.4)
    setup.lamp(rng.uniform(-180, 180), rng.uniform(50, 80), rng.uniform(0.3, 0.9) * tint, 0.4)
    setup.surround(rng.uniform(0.2, 0.45) * tint)


def _side_light(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    setup.lamp(_side(rng) * rng.uniform(70, 110), rng.uniform(-5, 35), colours.any(), rng.uniform(0.03, 0.25))
    setup.surround(rng.uniform(0.01, 0.1) * colours.any())


def _from_below(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    setup.lamp(rng.uniform(-40, 40), rng.uniform(-70, -25), colours.any(), rng.uniform(0.05, 0.3))
    setup.surround(rng.uniform(0.02, 0.15) * colours.any())


def _noon_sun(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    sky = colours.of(9000)
    setup.lamp(rng.uniform(-110, 110), rng.uniform(55, 85), colours.of(5500), 0.008)
    setup.glow(0, 90, rng.uniform(0.08, 0.2) * sky)
    setup.glow(0, -90, rng.uniform(0.03, 0.15) * colours.of(5000))  # from the ground
    setup.surround(rng.uniform(0.03, 0.1) * sky)


def _two_colours(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    side = _side(rng)
    setup.lamp(side * rng.uniform(40, 110), rng.uniform(-10, 40), colours.neon(), rng.uniform(0.1, 0.35))
    setup.lamp(-side * rng.uniform(40, 110), rng.uniform(-10, 40), rng.uniform(0.3, 1) * colours.neon(), 0.2)
    setup.surround(rng.uniform(0.03, 0.15) * colours.neon())


def _candle(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    setup.lamp(rng.uniform(-60, 60), rng.uniform(-40, 5), colours.of(colours.lowest_k), 0.04)
    setup.surround(rng.uniform(0.02, 0.1) * colours.of(colours.lowest_k))


def _stage(setup: Setup, rng: np.random.Generator, colours: Colours) -> None:
    for _ in range(2):
        tint = colours.neon() if rng.uniform() < 0.5 else colours.any()
        setup.lamp(rng.uniform(-130, 130), rng.uniform(20, 60), rng.uniform(0.3, 1) * tint, 0.03)
    setup.surround(rng.uniform(0.01, 0.06) * colours.any())


def night_setup(rng: np.random.Generator, colours: Colours) -> tuple[str, Setup]:
    """Draws one dim lamp, or the light of a screen, with almost no light around."""
    setup, is_screen = Setup(), rng.uniform() < 0.3
    if is_screen:
        setup.lamp(rng.uniform(-30, 30), rng.uniform(-50, -10), colours.of(9000), 0.25)
    else:
        setup.lamp(rng.uniform(-100, 100), rng.uniform(0, 60), colours.any(), rng.uniform(0.02, 0.1))
    setup.surround(rng.uniform(0.03, 0.15) * colours.any())
    if rng.uniform() < 0.4:
        setup.lamp(_side(rng) * rng.uniform(110, 170), rng.uniform(0, 40), rng.uniform(0.2, 1) * colours.neon(), 0.05)
    return "screen at night" if is_screen else "lamp at night", setup


Build = Callable[[Setup, np.random.Generator, Colours], None]
GENTLE_SETUPS: dict[str, Build] = {
    "key, fill and rim": _key_fill_rim,
    "softboxes": _softboxes,
    "flash on the camera": _flash_on_camera,
    "ring light": _ring_light,
    "window": _window,
    "overcast": _overcast,
    "office": _office,
}
HARSH_SETUPS: dict[str, Build] = {
    "side light": _side_light,
    "from below": _from_below,
    "noon sun": _noon_sun,
    "two colours": _two_colours,
    "candle": _candle,
    "stage": _stage,
}
