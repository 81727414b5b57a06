"""Draws the light of synthetic photographs.

Two lamps cast shadows. All other light is ambient and stored as spherical harmonics. Environments are projected to
harmonics without their lamps, so that no light counts twice.
"""

import math

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from datagen.appearance.light.environment_light import draw_environment_light, scaled_panorama
from datagen.appearance.light.harmonics import point_light
from datagen.appearance.light.light_colour import LUMINANCE
from datagen.appearance.light.light_config import KINDS, LightConfig
from datagen.appearance.light.light_sources import (
    GOBOS,
    MAX_LAMPS,
    Gobo,
    Lamplight,
    Light,
    PanoramaLight,
    angles_of,
    seen_illuminance,
)
from datagen.appearance.light.setups import Colours, Setup, draw_setup, night_setup
from datagen.random_streams import rounded, weighted_choice

_FAINT_LAMP = 0.03  # lamps with a smaller share of the light become ambient
_SOFT_KEY_SHARE = 0.25  # largest share of the lamps in soft light


def draw_light(rng: np.random.Generator, config: LightConfig) -> Light:
    """Draws the light of one photograph."""
    config.check()
    kind = weighted_choice(rng, {kind: getattr(config, f"{kind}_weight") for kind in KINDS})
    panoramas: tuple[PanoramaLight, ...] = ()
    if kind in ("studio", "night"):
        low, high = config.lamp_temperature_k
        colours = Colours(rng, low, high, camera_k=float(rng.triangular(3000, 5500, 7000)))
        is_studio = kind == "studio"
        name, setup = draw_setup(rng, colours, config.harsh_setup_share) if is_studio else night_setup(rng, colours)
    else:
        name, setup, panoramas = draw_environment_light(rng, config, kind)
        if kind == "soft":
            _soften(rng, setup)
        elif kind == "directional":
            _scale_lamps(rng, config, setup)
        else:
            _light_from_behind(rng, setup)
    is_ordinary = kind in ("soft", "directional", "studio")
    low, high = getattr(config, "illuminance" if is_ordinary else f"{kind}_illuminance")
    target = math.exp(rng.uniform(math.log(low), math.log(high)))
    gobo = _draw_gobo(rng) if kind in ("directional", "studio") and rng.uniform() < config.gobo_share else None
    return _finished(kind, name, setup, panoramas, (target, config.largest_lamp), gobo)


def _soften(rng: np.random.Generator, setup: Setup) -> None:
    """Turns the light of lamps beyond a share into ambient light around them, as clouds or curtains do."""
    ambient, by_lamps = _by_source(setup)
    allowed = rng.uniform(0, _SOFT_KEY_SHARE)
    share = by_lamps / max(ambient + by_lamps, 1e-9)
    if share <= allowed:
        return
    kept = allowed / (1 - allowed) * ambient / by_lamps
    for place, (direction, colour, radius) in enumerate(setup.lamps):
        setup.ambient += (1 - kept) * 0.5 * point_light(direction, colour)
        setup.ambient[0] += (1 - kept) * 0.5 * colour / 4  # the other half from all directions
        setup.lamps[place] = direction, kept * colour, max(radius, 0.2)


def _scale_lamps(rng: np.random.Generator, config: LightConfig, setup: Setup) -> None:
    """Scales the lamps to a random share of the light."""
    _light_lamp_if_dark(setup)
    ambient, by_lamps = _by_source(setup)
    share = rng.uniform(*config.key_share)
    factor = share / max(1 - share, 1e-3) * ambient / max(by_lamps, 1e-3)
    setup.lamps[:] = [(direction, factor * colour, radius) for direction, colour, radius in setup.lamps]


def _light_from_behind(rng: np.random.Generator, setup: Setup) -> None:
    """Makes the lamp behind the head so bright that edges and ears shine."""
    _light_lamp_if_dark(setup)
    direction, colour, radius = setup.lamps[0]
    brightness = rng.uniform(1.0, 5.0) * float(LUMINANCE @ setup.ambient[0])
    setup.lamps[0] = direction, colour * (brightness / max(float(LUMINANCE @ colour), 1e-9)), radius


def _light_lamp_if_dark(setup: Setup) -> None:
    """Gives the first lamp light if the environment has no lamps."""
    direction, colour, radius = setup.lamps[0]
    if LUMINANCE @ colour < 1e-3:
        setup.lamps[0] = direction, np.maximum(setup.ambient[0], 1e-3), radius


def _by_source(setup: Setup) -> tuple[float, float]:
    """Returns the luminance of a white ball in the ambient light, and in the light of the lamps."""
    ambient, by_lamps = seen_illuminance(setup.ambient, tuple((lamp[0], lamp[1]) for lamp in setup.lamps))
    return float(LUMINANCE @ ambient), float(LUMINANCE @ by_lamps)


def _draw_gobo(rng: np.random.Generator) -> Gobo:
    kind = GOBOS[int(rng.integers(len(GOBOS)))]
    low, high = {"blinds": (12, 45), "leaves": (18, 60), "bars": (60, 140)}[kind]
    turn = rng.normal(0, 0.25) + (np.pi / 2 if rng.uniform() < 0.2 else 0)
    x, y = rng.uniform(0, 1, size=2).round(3).tolist()
    return Gobo(
        kind=kind,
        period_mm=rounded(rng.uniform(low, high), 1),
        turn_rad=rounded(turn),
        shift=(x, y),
        depth=rounded(rng.uniform(0.5, 1)),
    )


def _finished(
    kind: str,
    name: str,
    setup: Setup,
    panoramas: tuple[PanoramaLight, ...],
    exposure: tuple[float, float],
    gobo: Gobo | None,
) -> Light:
    """Scales the light to its illuminance, keeps two lamps, and adds the others to the ambient light."""
    target, largest_lamp = exposure
    scale = target / max(sum(_by_source(setup)), 1e-9)
    setup.ambient *= scale
    lamps = sorted(((d, scale * c, r) for d, c, r in setup.lamps), key=lambda lamp: -float(LUMINANCE @ lamp[1]))
    for direction, colour, _ in lamps[MAX_LAMPS:]:
        setup.ambient += point_light(direction, colour)
    kept = []
    for direction, colour, radius in lamps[:MAX_LAMPS]:
        brightness = float(LUMINANCE @ colour)
        if brightness > _FAINT_LAMP * target:
            kept.append((direction, colour * min(1.0, largest_lamp / brightness), radius))
        else:
            setup.ambient += point_light(direction, colour)
    setup.lamps[:] = kept
    ambient, by_lamps = _by_source(setup)
    towards = kept[0][0] if kept else _brightest_side(setup.ambient)
    azimuth, elevation = angles_of(towards)
    return Light(
        kind=kind,
        setup=name,
        illuminance=round(ambient + by_lamps, 4),
        key_share=round(by_lamps / max(ambient + by_lamps, 1e-9), 4),
        key_azimuth_deg=round(azimuth, 2),
        key_elevation_deg=round(elevation, 2),
        lamps=tuple(_lamplight(*lamp) for lamp in kept),
        panoramas=tuple(scaled_panorama(panorama, scale) for panorama in panoramas),
        ambient=tuple(round(value, 6) for value in setup.ambient.reshape(-1).tolist()),
        gobo=gobo if kept else None,
    )


def _lamplight(direction: Float64[ndarray, "3"], colour: Float64[ndarray, "3"], radius_rad: float) -> Lamplight:
    x, y, z = (direction / np.linalg.norm(direction)).tolist()
    red, green, blue = colour.round(6).tolist()
    return Lamplight(direction=(x, y, z), colour=(red, green, blue), radius_rad=round(radius_rad, 4))


def _brightest_side(ambient: Float64[ndarray, "9 3"]) -> Float64[ndarray, "3"]:
    slope = ambient[1:4] @ LUMINANCE
    length = float(np.linalg.norm(slope))
    return np.asarray(slope / length) if length > 1e-9 else np.array([0.0, -1.0, 0.0])
