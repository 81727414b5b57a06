"""The light of a synthetic photograph as plain numbers; directions are in the camera frame."""

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
    """Light from one side, which casts shadows."""

    direction: Triple  # towards the lamp, camera frame (x right, y down, z forward), unit length
    colour: Triple  # what a white surface that faces it shows: irradiance / pi, linear
    radius_rad: float  # angle from the middle to the edge of the lamp: how soft shadows and highlights are


@final
@dataclass(frozen=True, kw_only=True)
class PanoramaLight:
    """An environment around the camera."""

    name: str
    heading_deg: float  # how far to the right of the panorama's middle the camera looks
    tilt_deg: float  # how far the camera looks up
    roll_deg: float  # how far the camera is turned clockwise
    # acts on linear colours: exposure, white balance, saturation and share of a mixture
    colour_matrix: tuple[Triple, Triple, Triple]


@final
@dataclass(frozen=True, kw_only=True)
class Gobo:
    """Something between the first lamp and the face that lets patches of light through."""

    kind: str  # `blinds`, `leaves` or `bars` (of a window)
    period_mm: float  # distance between slats, leaves or panes
    turn_rad: float  # rotation in the plane across the light
    shift: tuple[float, float]  # where the pattern begins, in periods
    depth: float  # how much light it takes away where it is darkest, 0..1


GOBOS = ("blinds", "leaves", "bars")  # numbered from 1 in light.glsl
MAX_LAMPS = 2  # that cast shadows; as in light.glsl


@final
@dataclass(frozen=True, kw_only=True)
class Light:
    """All light of one photograph."""

    kind: str  # `soft`, `directional`, `studio`, `backlit`, `silhouette` or `night`
    setup: str  # names of the environments, or of the arrangement of lamps
    illuminance: float  # what a white ball shows the camera on average; 1 is white
    key_share: float  # share of the lamps in that, 0..1
    key_azimuth_deg: float  # of the first lamp: 0 on the camera's side, 90 on the picture's right, 180 behind the head
    key_elevation_deg: float  # of the first lamp; 90 is straight above
    lamps: tuple[Lamplight, ...]  # at most two, the stronger first; both cast shadows
    panoramas: tuple[PanoramaLight, ...]  # at most two, whose light is added
    ambient: tuple[float, ...]  # nine harmonics of all light but the lamps', three colours each; camera frame
    gobo: Gobo | None  # in front of the first lamp


def environment_from_camera(panorama: PanoramaLight) -> Float64[ndarray, "3 3"]:
    """The rotation from the camera frame to the environment's frame."""
    heading, tilt, roll = np.deg2rad([panorama.heading_deg, panorama.tilt_deg, panorama.roll_deg])
    return _about_y(heading) @ _about_x(tilt) @ _about_z(roll)


def direction_of(azimuth_deg: float, elevation_deg: float) -> Float64[ndarray, "3"]:
    """Direction in the camera frame: azimuth from the camera's side, 90 the picture's right; elevation upward."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    across = math.cos(elevation)
    return np.array([math.sin(azimuth) * across, -math.sin(elevation), -math.cos(azimuth) * across])


def angles_of(direction: Float[ndarray, "3"]) -> tuple[float, float]:
    """Azimuth and elevation in degrees: the inverse of `direction_of`."""
    x, y, z = (float(value) for value in direction)
    return math.degrees(math.atan2(x, -z)), math.degrees(math.asin(max(-1.0, min(1.0, -y))))


def seen_illuminance(
    harmonics: Float[ndarray, "9 3"], lamps: tuple[tuple[Float[ndarray, "3"], Float[ndarray, "3"]], ...]
) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3"]]:
    """What a white ball shows the camera on average, in the light of harmonics, and of lamps (direction, colour)."""
    ambient = _WEIGHTS @ white_surface(harmonics, _NORMALS)
    by_lamps = np.zeros(3)
    for direction, colour in lamps:
        by_lamps += float(_WEIGHTS @ np.maximum(_NORMALS @ direction, 0)) * np.asarray(colour)
    return ambient, by_lamps


def seen_light(light: Light) -> Float64[ndarray, "3"]:
    """What a white ball shows the camera on average, linear."""
    ambient = np.array(light.ambient).reshape(-1, 3)
    lamps = tuple((np.array(lamp.direction), np.array(lamp.colour)) for lamp in light.lamps)
    return np.sum(seen_illuminance(ambient, lamps), axis=0)


def _visible_half() -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, " n"]]:
    """Normals of a ball that the camera sees, and the apparent sizes of their patches."""
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
