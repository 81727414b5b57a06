"""What lights a synthetic photograph: plain numbers, stored with the sample. Directions in the camera frame."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from datagen.appearance.light.harmonics import fibonacci_sphere, white_surface

Triple = tuple[float, float, float]


@final
@dataclass(frozen=True, kw_only=True)
class Lamplight:
    """Light from one side, which casts shadows.

    Attributes:
        direction: Towards the lamp, camera frame (x right, y down, z forward), unit length.
        colour: What a white surface that faces it shows: irradiance / pi, linear.
        radius_rad: Angle from the middle to the edge of the lamp: how soft shadows and highlights are.
    """

    direction: Triple
    colour: Triple
    radius_rad: float


@final
@dataclass(frozen=True, kw_only=True)
class PanoramaLight:
    """An environment around the camera.

    Attributes:
        name: Of the environment.
        heading_deg: How far to the right of the panorama's middle the camera looks.
        tilt_deg: How far it looks up.
        roll_deg: How far it is turned clockwise.
        colour_matrix: Acts on the panorama's linear colours: exposure, white balance, saturation, share of a mixture.
    """

    name: str
    heading_deg: float
    tilt_deg: float
    roll_deg: float
    colour_matrix: tuple[Triple, Triple, Triple]


@final
@dataclass(frozen=True, kw_only=True)
class Gobo:
    """Something between the first lamp and the face that lets light through in patches.

    Attributes:
        kind: ``blinds``, ``leaves`` or ``bars`` (of a window).
        period_mm: Distance of slats, leaves, panes.
        turn_rad: In the plane across the light.
        shift: Where the pattern begins, in periods.
        depth: How much it takes away where it is darkest, 0..1.
    """

    kind: str
    period_mm: float
    turn_rad: float
    shift: tuple[float, float]
    depth: float


GOBOS = ("blinds", "leaves", "bars")  # numbered from 1 in light.glsl


@final
@dataclass(frozen=True, kw_only=True)
class Light:
    """All light of one photograph.

    Attributes:
        kind: ``soft``, ``directional``, ``studio``, ``backlit``, ``silhouette`` or ``night``.
        setup: The environments' names, or the name of the arrangement of lamps.
        illuminance: What a white ball shows on average, seen by the camera: 1 is white.
        key_share: How much of that the lamps give, 0..1.
        key_azimuth_deg: Of the first lamp, from the camera's side; 90 is the picture's right, 180 behind the head.
        key_elevation_deg: Of the first lamp; 90 is straight above.
        lamps: At most two; both cast shadows; the first is the stronger.
        panoramas: At most two, their light added.
        ambient: All light but the lamps': nine harmonics, one after the other, three colours each; camera frame.
        gobo: Before the first lamp, or None.
    """

    kind: str
    setup: str
    illuminance: float
    key_share: float
    key_azimuth_deg: float
    key_elevation_deg: float
    lamps: tuple[Lamplight, ...]
    panoramas: tuple[PanoramaLight, ...]
    ambient: tuple[float, ...]
    gobo: Gobo | None


def environment_from_camera(panorama: PanoramaLight) -> Float64[ndarray, "3 3"]:
    """Turns directions of the camera frame into the environment's."""
    heading, tilt, roll = np.deg2rad([panorama.heading_deg, panorama.tilt_deg, panorama.roll_deg])
    return _about_y(heading) @ _about_x(tilt) @ _about_z(roll)


def direction_of(azimuth_deg: float, elevation_deg: float) -> Float64[ndarray, "3"]:
    """Direction in the camera frame: azimuth from the camera's side, 90 the picture's right; elevation upward."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    across = math.cos(elevation)
    return np.array([math.sin(azimuth) * across, -math.sin(elevation), -math.cos(azimuth) * across])


def angles_of(direction: Float[ndarray, "3"]) -> tuple[float, float]:
    """Azimuth and elevation in degrees: the inverse of ``direction_of``."""
    x, y, z = (float(value) for value in direction)
    return math.degrees(math.atan2(x, -z)), math.degrees(math.asin(max(-1.0, min(1.0, -y))))


def seen_illuminance(
    harmonics: Float[ndarray, "9 3"], lamps: tuple[tuple[Float[ndarray, "3"], Float[ndarray, "3"]], ...]
) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3"]]:
    """What a white ball shows the camera on average: by the harmonics, and by lamps (direction, colour)."""
    ambient = _WEIGHTS @ white_surface(harmonics, _NORMALS)
    by_lamps = np.zeros(3)
    for direction, colour in lamps:
        by_lamps += float(_WEIGHTS @ np.maximum(_NORMALS @ direction, 0)) * np.asarray(colour)
    return ambient, by_lamps


def seen_light(light: Light) -> Float64[ndarray, "3"]:
    """What a white ball in a light shows the camera on average, linear."""
    ambient = np.array(light.ambient).reshape(-1, 3)
    lamps = tuple((np.array(lamp.direction), np.array(lamp.colour)) for lamp in light.lamps)
    return np.sum(seen_illuminance(ambient, lamps), axis=0)


def _visible_half() -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, " n"]]:
    """Normals of a ball that the camera sees, and how large their patches look."""
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
