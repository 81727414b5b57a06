"""The light of a synthetic photograph, with directions in the camera frame."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from datagen.appearance.light.harmonics import fibonacci_sphere, white_surface
from datagen.random_streams import Triple


@final
@dataclass(frozen=True, kw_only=True)
class Lamplight:
    """A lamp that casts shadows."""

    direction: Triple  # towards the lamp, camera frame (x right, y down, z forward), unit length
    colour: Triple  # linear radiance of a white surface that faces it: irradiance / pi
    radius_rad: float  # angular radius, which makes shadows and highlights soft


@final
@dataclass(frozen=True, kw_only=True)
class PanoramaLight:
    """An environment around the camera."""

    name: str
    heading_deg: float  # how far to the right of the panorama's middle the camera looks
    tilt_deg: float  # how far the camera looks up
    roll_deg: float  # how far the camera is turned clockwise
    # matrix for linear colours, with exposure, white balance, saturation and the share in a mixture
    colour_matrix: tuple[Triple, Triple, Triple]


@final
@dataclass(frozen=True, kw_only=True)
class Gobo:
    """A pattern of shadows from something between the first lamp and the face."""

    kind: str  # `blinds`, `leaves` or `bars` (of a window)
    period_mm: float  # distance between slats, leaves or panes
    turn_rad: float  # rotation in the plane perpendicular to the light
    shift: tuple[float, float]  # offset of the pattern, in periods
    depth: float  # largest share of the light that it blocks, 0..1


GOBOS = ("blinds", "leaves", "bars")  # numbered from 1 in light.glsl
MAX_LAMPS = 2  # lamps that cast shadows; as in light.glsl


@final
@dataclass(frozen=True, kw_only=True)
class Light:
    """All light of one photograph."""

    kind: str  # `soft`, `directional`, `studio`, `backlit`, `silhouette` or `night`
    setup: str  # names of the environments, or of the arrangement of lamps
    illuminance: float  # mean brightness of a white ball; 1 is white
    key_share: float  # share of the lamps in the illuminance, 0..1
    key_azimuth_deg: float  # of the first lamp: 0 on the camera's side, 90 on the picture's right, 180 behind the head
    key_elevation_deg: float  # of the first lamp; 90 is straight above
    lamps: tuple[Lamplight, ...]  # at most two, the brighter first; both cast shadows
    panoramas: tuple[PanoramaLight, ...]  # at most two, whose light is added
    ambient: tuple[float, ...]  # nine harmonics of all other light, three colours each; camera frame
    gobo: Gobo | None  # in front of the first lamp


def environment_from_camera(panorama: PanoramaLight) -> Float64[ndarray, "3 3"]:
    """Returns the rotation from the camera frame to the frame of the environment."""
    heading, tilt, roll = np.deg2rad([panorama.heading_deg, panorama.tilt_deg, panorama.roll_deg])
    return _about_y(heading) @ _about_x(tilt) @ _about_z(roll)


def direction_of(azimuth_deg: float, elevation_deg: float) -> Float64[ndarray, "3"]:
    """Returns a direction in the camera frame. Azimuth 0 is the camera's side, 90 the picture's right."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    across = math.cos(elevation)
    return np.array([math.sin(azimuth) * across, -math.sin(elevation), -math.cos(azimuth) * across])


def angles_of(direction: Float[ndarray, "3"]) -> tuple[float, float]:
    """Returns azimuth and elevation in degrees, the inverse of `direction_of`."""
    x, y, z = (float(value) for value in direction)
    return math.degrees(math.atan2(x, -z)), math.degrees(math.asin(max(-1.0, min(1.0, -y))))


def seen_illuminance(
    harmonics: Float[ndarray, "9 3"], lamps: tuple[tuple[Float[ndarray, "3"], Float[ndarray, "3"]], ...]
) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3"]]:
    """Returns the mean colour of a white ball in the light of harmonics, and in that of lamps (direction, colour)."""
    ambient = _WEIGHTS @ white_surface(harmonics, _NORMALS)
    by_lamps = np.zeros(3)
    for direction, colour in lamps:
        by_lamps += float(_WEIGHTS @ np.maximum(_NORMALS @ direction, 0)) * np.asarray(colour)
    return ambient, by_lamps


def seen_light(light: Light) -> Float64[ndarray, "3"]:
    """Returns the mean linear colour of a white ball, as the camera sees it."""
    ambient = np.array(light.ambient).reshape(-1, 3)
    lamps = tuple((np.array(lamp.direction), np.array(lamp.colour)) for lamp in light.lamps)
    return np.sum(seen_illuminance(ambient, lamps), axis=0)


def _visible_half() -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, " n"]]:
    """Returns normals on the visible half of a ball, and the apparent sizes of their patches."""
    normals = fibonacci_sphere(128)
    normals = normals[normals[:, 2] < 0]
    weights = -normals[:, 2]
    return normals, weights / weights.sum()


_NORMALS, _WEIGHTS = _visible_half()


def _about_y(angle: float) -> Float64[ndarray, "3 3"]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _about_x(angle: float) -> Float64[ndarray, "3 3"]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _about_z(angle: float) -> Float64[ndarray, "3 3"]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
