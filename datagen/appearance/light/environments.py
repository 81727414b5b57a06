"""The environments that light faces and are seen behind them: high-dynamic-range panoramas and their lamps.

The frame of an environment is that of a camera that looks at the middle of the panorama: x right, y down, z forward.
Column 0 is straight behind, columns run to the right, and rows run down from the zenith.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import cv2
import h5py
import numpy as np
from jaxtyping import Float, Float32, Float64, UInt8
from numpy import ndarray

from datagen.appearance.asset_files import open_asset
from datagen.appearance.light.harmonics import project_radiance
from datagen.appearance.light.light_colour import LUMINANCE
from datagen.appearance.light.light_sources import PanoramaLight, environment_from_camera
from pix2face.files.images import srgb_to_linear
from pix2face.geometry.camera import Camera, pinhole_of

_FILE = "environments.h5"
# A lamp is at least this many times brighter than the mean, and lies within this radius.
LAMP_CONTRAST, LAMP_RADIUS_DEG = 4.0, 22.0
N_LAMPS = 2


@final
@dataclass(frozen=True, eq=False)
class Lamp:
    """Something bright in an environment: the sun, a window, a lamp."""

    direction: Float64[ndarray, "3"]  # towards the lamp, unit length, environment frame
    colour: Float64[ndarray, "3"]  # linear radiance of a white surface that faces it: irradiance / pi
    radius_rad: float  # angular radius: the root mean square of the angle from the centre, times sqrt(2)


@final
@dataclass(frozen=True, eq=False)
class Environment:
    """An environment, split into lamps and the rest."""

    lamps: tuple[Lamp, ...]  # always `N_LAMPS`, the brightest first; missing ones are black
    rest: Float32[ndarray, "h w 3"]  # the panorama without its lamps
    harmonics: Float64[ndarray, "9 3"]  # spherical harmonics of the rest
    mean: Float64[ndarray, "3"]  # mean colour of the whole panorama over the sphere


@lru_cache(maxsize=1)
def environment_names() -> tuple[str, ...]:
    """Returns the names of all environments, sorted, in the order of the texture's layers."""
    return tuple(sorted(_light_panoramas()))


def light_panorama(name: str) -> Float32[ndarray, "64 128 3"]:
    """Returns the linear radiance of an environment at low resolution."""
    return _light_panoramas()[name]


@lru_cache(maxsize=18)
def environment(name: str) -> Environment:
    """Returns an environment, split into lamps and the rest."""
    panorama = light_panorama(name)
    directions, solid_angles = panorama_grid(*panorama.shape[:2])
    rest, lamps = panorama.astype(np.float64), []
    for _ in range(N_LAMPS):
        rest, lamp = _take_lamp(rest, directions, solid_angles)
        lamps.append(lamp)
    flat = directions.reshape(-1, 3), rest.reshape(-1, 3), solid_angles.reshape(-1)
    mean = np.tensordot(solid_angles, panorama, 2) / (4 * np.pi)
    lamps.sort(key=lambda lamp: -float(LUMINANCE @ lamp.colour))
    return Environment(tuple(lamps), rest.astype(np.float32), project_radiance(*flat), mean)


@lru_cache(maxsize=18)
def picture_panorama(name: str) -> Float32[ndarray, "h w 3"]:
    """Returns the linear panorama of an environment at full resolution, for backdrops."""
    with open_asset(_FILE) as file:
        group = file[name]
        picture = _decoded(group["picture"], cv2.IMREAD_COLOR)[..., ::-1]
        gain = _decoded(group["gain"], cv2.IMREAD_GRAYSCALE)
        stops = np.float32(file.attrs["gain_stops"] / 255)
    steps = np.arange(256, dtype=np.float32)  # the values of a byte
    # Steps of one or two are ringing of the JPEG beside bright objects, where nothing is brighter than white.
    bright = cv2.LUT(gain, np.where(steps > 2, np.exp2(steps * stops), 1).astype(np.float32))
    return np.asarray(cv2.LUT(picture, srgb_to_linear(steps / 255)) * bright[..., None], dtype=np.float32)


def panorama_grid(height: int, width: int) -> tuple[Float64[ndarray, "h w 3"], Float64[ndarray, "h w"]]:
    """Returns direction and solid angle (steradians) of each texel."""
    edges = np.linspace(0, np.pi, height + 1)
    polar = (edges[:-1] + edges[1:]) / 2
    azimuth = (np.arange(width) + 0.5) / width * 2 * np.pi - np.pi
    sine = np.sin(polar)[:, None]
    up = np.broadcast_to(-np.cos(polar)[:, None], (height, width))
    directions = np.stack([sine * np.sin(azimuth), up, sine * np.cos(azimuth)], axis=2)
    solid_angles = (np.cos(edges[:-1]) - np.cos(edges[1:])) * (2 * np.pi / width)
    return directions, np.repeat(solid_angles[:, None], width, axis=1)


def panorama_place(directions: Float[ndarray, "*n 3"], height: int, width: int) -> Float[ndarray, "*n 2"]:
    """Returns (column, row) of unit vectors in a panorama. Texel (i, j) has its centre at (j, i), as in OpenCV."""
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    column = (np.arctan2(x, z) / (2 * np.pi) + 0.5) * width - 0.5
    row = np.arccos(np.clip(-y, -1, 1)) / np.pi * height - 0.5
    return np.stack([column, row], axis=-1)


def softened_panorama(panorama: Float32[ndarray, "h w 3"], angle_rad: float) -> Float32[ndarray, "h w 3"]:
    """Blurs a panorama by approximately a Gaussian on the sphere, as a rough surface reflects it."""
    height, width = panorama.shape[:2]
    over_poles = np.concatenate([np.roll(panorama[::-1], width // 2, axis=1), panorama] * 2)[height // 2 :]
    sigma = angle_rad / np.pi * height
    blurred = cv2.GaussianBlur(over_poles[: 2 * height], (1, 0), sigmaX=0.01, sigmaY=sigma)
    rows = blurred[height // 2 : height // 2 + height]
    latitude = np.sin((np.arange(height) + 0.5) / height * np.pi)[:, None, None]
    transfer = np.exp(-0.5 * (np.arange(width // 2 + 1)[:, None] * angle_rad / latitude) ** 2)
    return np.maximum(np.fft.irfft(np.fft.rfft(rows, axis=1) * transfer, width, axis=1), 0).astype(np.float32)


def _take_lamp(
    rest: Float64[ndarray, "h w 3"], directions: Float64[ndarray, "h w 3"], solid_angles: Float64[ndarray, "h w"]
) -> tuple[Float64[ndarray, "h w 3"], Lamp]:
    """Removes the light of the brightest spot above a threshold, and returns it as a lamp."""
    luminance = rest @ LUMINANCE
    threshold = LAMP_CONTRAST * np.sum(luminance * solid_angles) / (4 * np.pi)
    excess = np.maximum(1 - threshold / np.maximum(luminance, 1e-9), 0)
    power = excess * luminance * solid_angles
    brightest = directions[np.unravel_index(np.argmax(power), power.shape)]
    for _ in range(2):  # moves the window to the centroid of its light
        near = directions @ brightest > np.cos(np.deg2rad(LAMP_RADIUS_DEG))
        middle = np.tensordot(power * near, directions, 2)
        if not np.linalg.norm(middle) > 0:
            return rest, Lamp(np.array([0.0, -1.0, 0.0]), np.zeros(3), 0.1)
        brightest = middle / np.linalg.norm(middle)
    removed = rest * (excess * near)[..., None]
    spread = np.sum(power * near * np.arccos(np.clip(directions @ brightest, -1, 1)) ** 2) / np.sum(power * near)
    colour = np.tensordot(solid_angles, removed, 2) / np.pi
    return rest - removed, Lamp(brightest, colour, float(np.clip(np.sqrt(2 * spread), 0.01, 0.5)))


@lru_cache(maxsize=1)
def _light_panoramas() -> dict[str, Float32[ndarray, "64 128 3"]]:
    with open_asset(_FILE) as file:
        return {name: file[name]["light"][:].astype(np.float32) for name in file}


def _decoded(stored: h5py.Dataset, flags: int) -> UInt8[ndarray, "..."]:
    picture = cv2.imdecode(stored[:], flags)
    assert picture is not None
    return np.asarray(picture, dtype=np.uint8)


# Angle of view that is used for affine cameras, which have none.
AFFINE_VIEW_DEG = 25.0
# Samples for each texel of a panorama; more would show no more detail.
_SAMPLES_PER_TEXEL, _FEWEST_SAMPLES = 1.6, 24


def panorama_view(
    panoramas: tuple[PanoramaLight, ...], camera: Camera, size: tuple[int, int], view_deg: float
) -> Float32[ndarray, "h w 3"]:
    """Renders environments as a camera sees them, in linear light, at most at the resolution of the panoramas.

    Args:
        panoramas: Environments, whose light is added. They contain the rotation of the camera.
        camera: Camera of the picture, of which only focal length and principal point are used.
        size: Height and width of the picture. The result may be smaller.
        view_deg: Angle of view across the picture's width; 0 uses that of the camera.
    """
    height, width = size
    focal, x, y = _intrinsics(camera, size, view_deg)
    texels = math.degrees(2 * math.atan(width / 2 / focal)) / 360 * picture_panorama(panoramas[0].name).shape[1]
    n = int(np.clip(_SAMPLES_PER_TEXEL * texels, _FEWEST_SAMPLES, max(width, _FEWEST_SAMPLES)))
    rows, columns = max(2, round(n * height / width)), n
    across = ((np.arange(columns) + 0.5) * width / columns - x) / focal
    down = ((np.arange(rows) + 0.5) * height / rows - y) / focal
    rays = np.ones((rows, columns, 3))
    rays[..., 0], rays[..., 1] = across[None], down[:, None]
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    total = np.zeros((rows, columns, 3), dtype=np.float32)
    for panorama in panoramas:
        seen = look_up(panorama.name, rays @ environment_from_camera(panorama).T)
        total += seen @ np.array(panorama.colour_matrix, dtype=np.float32).T
    return np.maximum(total, 0)


def look_up(name: str, directions: Float64[ndarray, "h w 3"]) -> Float32[ndarray, "h w 3"]:
    """Returns the light of an environment from directions in its frame, interpolated linearly, also across the seam."""
    panorama = picture_panorama(name)
    height, width = panorama.shape[:2]
    place = panorama_place(directions, height, width).astype(np.float32)
    np.clip(place[..., 1], 0, height - 1, out=place[..., 1])
    found = cv2.remap(panorama, place[..., 0], place[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(found, dtype=np.float32)


def _intrinsics(camera: Camera, size: tuple[int, int], view_deg: float) -> tuple[float, float, float]:
    """Returns focal length and principal point (x, y) in pixels."""
    height, width = size
    if view_deg <= 0 and not camera.is_affine:
        pinhole = pinhole_of(camera)
        x, y = (float(value) for value in pinhole.principal_point_px)
        return pinhole.focal_px, x, y
    view = math.radians(view_deg if view_deg > 0 else AFFINE_VIEW_DEG)
    return width / 2 / math.tan(view / 2), width / 2, height / 2
