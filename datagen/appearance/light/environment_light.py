"""Draws the light of one or two environments, with a rotation and colour as in a photograph."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from datagen.appearance.light.environments import Environment, environment, environment_names
from datagen.appearance.light.harmonics import turned
from datagen.appearance.light.light_colour import LUMINANCE, balance_matrix, saturation_matrix
from datagen.appearance.light.light_config import LightConfig
from datagen.appearance.light.light_sources import PanoramaLight, direction_of, environment_from_camera
from datagen.appearance.light.setups import Setup
from datagen.random_streams import Triple, rounded, triple

# Azimuth of the brightest lamp: mean and standard deviation (0 is the camera's side).
_KEY_AZIMUTHS_DEG = {"directional": (0.0, 50.0), "backlit": (180.0, 28.0), "silhouette": (180.0, 18.0)}
_LARGEST_AZIMUTH_DEG = 105.0  # largest azimuth of a lamp that lights the face


def draw_environment_light(
    rng: np.random.Generator, config: LightConfig, kind: str
) -> tuple[str, Setup, tuple[PanoramaLight, ...]]:
    """Draws environments, and turns them so that the brightest lamp suits the kind of light.

    Returns:
        Names of the environments; their light in the camera frame; the environments themselves, for reflections and the
        backdrop. Their mean luminances sum to about 1.
    """
    count = 2 if rng.uniform() < config.mixture_share else 1
    names = [str(name) for name in rng.choice(environment_names(), size=count, replace=False)]
    share = rng.uniform(0.5, 0.9) if count == 2 else 1.0
    saturation, balance = rng.uniform(*config.saturation), rng.uniform(*config.white_balance)
    panoramas, setup = [], Setup()
    for place, name in enumerate(names):
        source = environment(name)
        heading = _heading(rng, source, kind if place == 0 else "soft")
        tilt, roll = np.clip(rng.normal(0, config.tilt_deg, size=2), -30, 30)
        weight = share if place == 0 else 1 - share
        matrix = weight * saturation_matrix(saturation) @ balance_matrix(source.mean, balance)
        panorama = PanoramaLight(
            name=name,
            heading_deg=round(heading, 2),
            tilt_deg=rounded(tilt, 2),
            roll_deg=rounded(roll, 2),
            colour_matrix=_rows(matrix / (LUMINANCE @ source.mean)),
        )
        panoramas.append(panorama)
        add_environment(setup, source, panorama)
    return " + ".join(names), setup, tuple(panoramas)


def add_environment(setup: Setup, source: Environment, panorama: PanoramaLight) -> None:
    """Adds the lamps and the other light of an environment to a setup."""
    camera_from_environment = environment_from_camera(panorama).T
    matrix = np.array(panorama.colour_matrix)
    for lamp in source.lamps:
        colour = np.maximum(matrix @ lamp.colour, 0)
        setup.lamps.append((camera_from_environment @ lamp.direction, colour, lamp.radius_rad))
    setup.ambient += turned(source.harmonics, camera_from_environment) @ matrix.T


def scaled_panorama(panorama: PanoramaLight, factor: float) -> PanoramaLight:
    """Multiplies the light of an environment by a factor."""
    return replace(panorama, colour_matrix=_rows(factor * np.array(panorama.colour_matrix)))


def _heading(rng: np.random.Generator, source: Environment, kind: str) -> float:
    if kind not in _KEY_AZIMUTHS_DEG:
        return float(rng.uniform(0, 360))
    mean, spread = _KEY_AZIMUTHS_DEG[kind]
    azimuth = rng.normal(mean, spread)
    if mean == 0:
        azimuth = np.clip(azimuth, -_LARGEST_AZIMUTH_DEG, _LARGEST_AZIMUTH_DEG)
    x, _, z = direction_of(float(azimuth), 0)
    wanted = np.arctan2(x, z)
    direction = source.lamps[0].direction
    return float(np.rad2deg(np.arctan2(direction[0], direction[2]) - wanted) % 360)


def _rows(matrix: Float64[ndarray, "3 3"]) -> tuple[Triple, Triple, Triple]:
    first, second, third = (triple(row, 6) for row in matrix)
    return first, second, third
