"""The appearance `plain`, for any model: skin, hair and eyes in random human colours, in random light.

Colour, light and surroundings vary widely, so that a network learns that they are independent of the shape of a face.
"""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from datagen.appearance.scene import Colour, Surface
from datagen.random_streams import triple
from pix2face.files.images import srgb_to_linear
from pix2face.geometry.camera import Camera, nearest_weak_perspective

MAX_LIGHTS = 3  # as in picture_fragment.glsl

# sRGB, 0..1. Human skin from the lightest to the darkest; hair from black to blond, and grey; irises.
SKIN_TONES = np.array(
    [[250, 224, 208], [238, 199, 172], [218, 170, 137], [184, 131, 95], [133, 87, 59], [88, 56, 40], [58, 37, 28]]
) / np.float32(255)
HAIR_TONES = np.array([[18, 15, 14], [42, 30, 24], [82, 56, 38], [128, 82, 46], [186, 148, 96], [150, 148, 146]]) / 255
IRIS_TONES = np.array([[52, 30, 18], [84, 52, 28], [112, 92, 48], [92, 112, 82], [88, 124, 150], [120, 132, 138]]) / 255
SCLERA, PUPIL, TEETH = (0.90, 0.88, 0.86), (0.03, 0.03, 0.03), (0.86, 0.82, 0.74)
MOUTH_INSIDE, TONGUE = (0.30, 0.10, 0.10), (0.66, 0.34, 0.33)

# Gloss: 0 is skin, 1 a wet eye.
GLOSS = {"eyes": 0.7, "iris": 1.0, "pupil": 1.0, "lips": 0.12, "teeth": 0.5, "tongue": 0.25, "mouth_inside": 0.15}


@final
@dataclass(frozen=True)
class PlainAppearance:
    """Everything in the picture of a face except its shape. `dataclasses.asdict` makes it JSON."""

    skin_rgb: Colour  # sRGB, 0..1, like the next four
    lips_rgb: Colour
    hair_rgb: Colour  # of the scalp
    brows_rgb: Colour
    iris_rgb: Colour
    flush: float  # how much redder cheeks, nose and ears are, 0..1
    beard: float  # how dark the beard area is, 0..1
    blotchiness: float  # relative amplitude of the large spots of skin and hair
    texture_seed: int
    ambient_rgb: Colour  # light from everywhere, linear; 1 shows a colour as it is
    light_directions: tuple[Colour, ...]  # towards each light, camera frame (x right, y down, z forward), unit length
    light_rgb: tuple[Colour, ...]  # linear colour of each light
    shine: float  # strength of the skin's highlights, 0..1
    blur_px: float  # standard deviation of the lens's blur
    noise: float  # standard deviation of the sensor's noise, 0..1
    noise_seed: int


def draw_plain_appearance(rng: np.random.Generator) -> PlainAppearance:
    """Draws an appearance."""
    darkness = float(rng.uniform())
    skin = _tone(SKIN_TONES, darkness) * rng.normal(1, [0.05, 0.03, 0.06])
    # People with dark skin have dark hair and eyes; those with light skin have any.
    hair = _tone(HAIR_TONES, rng.uniform(0, 1.25 - darkness)) * rng.uniform(0.6, 1.3)
    iris = _tone(IRIS_TONES, rng.uniform(0, 1) * (1 - darkness)) * rng.uniform(0.8, 1.2)
    lips = 0.7 * skin * [1, 0.82, 0.85] + 0.3 * np.array([0.62, 0.22, 0.25])
    if rng.uniform() < 0.15:  # lipstick
        lips = np.array([rng.uniform(0.4, 0.8), *rng.uniform(0.05, 0.35, size=2)])
    directions, colours, ambient = _draw_light(rng)
    return PlainAppearance(
        skin_rgb=triple(skin, 5),
        lips_rgb=triple(lips, 5),
        hair_rgb=triple(skin * 0.85 if rng.uniform() < 0.15 else hair, 5),  # some are bald
        brows_rgb=triple(0.6 * np.minimum(hair, 0.8 * skin) + 0.4 * skin * 0.7, 5),
        iris_rgb=triple(iris, 5),
        flush=float(rng.uniform(0, 0.6)),
        beard=float(rng.uniform(0.1, 0.8) if rng.uniform() < 0.35 else 0),
        blotchiness=float(rng.uniform(0.01, 0.06)),
        texture_seed=int(rng.integers(2**31)),
        ambient_rgb=triple(ambient, 5),
        light_directions=tuple(triple(direction, 5) for direction in directions),
        light_rgb=tuple(triple(colour, 5) for colour in colours),
        shine=float(rng.uniform(0.0, 0.10)),
        blur_px=float(max(0, rng.normal(0.2, 0.4))),
        noise=float(rng.exponential(0.012)),
        noise_seed=int(rng.integers(2**31)),
    )


def vertex_paint(appearance: PlainAppearance, surface: Surface) -> Float32[ndarray, "v 4"]:
    """Returns colour (linear, 0..1) and gloss of each vertex."""
    names, weights = surface.region_names, surface.region_weights
    colours = np.stack([srgb_to_linear(np.array(_region_colour(appearance, name))) for name in names])
    albedo = weights @ colours.astype(np.float32)
    skin_like = weights @ np.array([name in ("skin", "ears", "neck", "lips") for name in names], dtype=np.float32)
    rough = weights @ np.array([8.0 if name in ("scalp", "brows") else GLOSS.get(name, 0) == 0 for name in names])
    flush, beard = _flush_and_beard(surface.mean)
    flush, beard = appearance.flush * flush * skin_like, appearance.beard * beard * skin_like
    albedo *= 1 + flush[:, None] * np.array([0.05, -0.35, -0.30], dtype=np.float32)
    stubble = srgb_to_linear(np.array(appearance.brows_rgb)).astype(np.float32)
    albedo += 0.6 * beard[:, None] * (np.minimum(stubble, albedo) - albedo)
    albedo *= 1 + (appearance.blotchiness * rough * _spots(appearance.texture_seed, surface.mean))[:, None]
    gloss = weights @ np.array([GLOSS.get(name, 0) for name in names], dtype=np.float32)
    return np.concatenate([np.clip(albedo, 0, 1), gloss[:, None]], axis=1).astype(np.float32)


def lights_in_model(
    appearance: PlainAppearance, camera: Camera
) -> tuple[Float32[ndarray, "3 3"], Float32[ndarray, "3 3"]]:
    """Returns directions (model frame) and colours of the lights; unused ones are black."""
    model_from_camera = nearest_weak_perspective(camera).rotation.T
    directions, colours = np.zeros((2, MAX_LIGHTS, 3), dtype=np.float32)
    count = len(appearance.light_directions)
    directions[:count] = np.asarray(appearance.light_directions).reshape(count, 3) @ model_from_camera.T
    colours[:count] = np.asarray(appearance.light_rgb).reshape(count, 3)
    directions[count:] = [0, 0, 1]
    return directions, colours


def develop(image: UInt8[ndarray, "h w 3"], appearance: PlainAppearance) -> UInt8[ndarray, "h w 3"]:
    """Adds the blur of the lens and the noise of the sensor to a picture."""
    out = image
    if appearance.blur_px > 0.2:
        out = cv2.GaussianBlur(out, (0, 0), appearance.blur_px)
    noise = np.random.default_rng(appearance.noise_seed).standard_normal(image.shape, dtype=np.float32)
    return np.clip(out + noise * np.float32(255 * appearance.noise) + 0.5, 0, 255).astype(np.uint8)


def _draw_light(rng: np.random.Generator) -> tuple[ndarray, ndarray, ndarray]:
    """Draws directions and colours of one to three lights, and ambient light; a lit surface has about 1 in all."""
    count = int(rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15]))
    azimuth = rng.normal(0, np.deg2rad(50), size=count)
    elevation = rng.normal(np.deg2rad(25), np.deg2rad(25), size=count)
    directions = np.stack(
        [np.sin(azimuth) * np.cos(elevation), -np.sin(elevation), -np.cos(azimuth) * np.cos(elevation)], axis=1
    )
    warmth = rng.normal(0, 0.12, size=count + 1)
    tints = np.exp(np.stack([warmth, np.zeros(count + 1), -warmth], axis=1))
    ambient = rng.uniform(0.15, 0.7)
    shares = rng.dirichlet(np.full(count, 2.0)) * (1.15 - ambient)
    exposure = float(np.exp(rng.normal(0, 0.25)))
    return directions, exposure * shares[:, None] * tints[1:], exposure * ambient * tints[0]


def _region_colour(appearance: PlainAppearance, region: str) -> Colour:
    """Returns the colour of a region, sRGB. Unlisted regions are skin."""
    return {
        "lips": appearance.lips_rgb,
        "scalp": appearance.hair_rgb,
        "brows": appearance.brows_rgb,
        "eyes": SCLERA,
        "iris": appearance.iris_rgb,
        "pupil": PUPIL,
        "teeth": TEETH,
        "tongue": TONGUE,
        "mouth_inside": MOUTH_INSIDE,
    }.get(region, appearance.skin_rgb)


def _flush_and_beard(mean: Float32[ndarray, "v 3"]) -> tuple[Float32[ndarray, " v"], Float32[ndarray, " v"]]:
    """Returns weights, 0..1, of flushed skin (cheeks, nose, ears) and of the beard area, at places of the mean face."""
    x, y, z = np.abs(mean[:, 0]), mean[:, 1], mean[:, 2]
    cheek = np.exp(-(((x - 42) / 20) ** 2) - ((y + 15) / 18) ** 2) * (z > 20)
    nose = np.exp(-((x / 12) ** 2) - ((y + 12) / 14) ** 2) * (z > 60)
    ear = np.exp(-(((x - 85) / 14) ** 2)) * (z < 20)
    jaw = 1 / (1 + np.exp((y + 38 - 0.25 * np.maximum(x - 35, 0) ** 1.2) / 4)) / (1 + np.exp(-(z - 8) / 6))
    return np.clip(cheek + nose + 0.6 * ear, 0, 1), jaw


def _spots(seed: int, mean: Float32[ndarray, "v 3"]) -> Float32[ndarray, " v"]:
    """Returns smooth noise over the head, with wavelengths of 4 to 12 cm and unit standard deviation."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(3, 12)) * rng.uniform(1 / 20, 1 / 7, size=12) / np.sqrt(3)
    phases = rng.uniform(0, 2 * np.pi, size=12)
    return (np.sin(mean @ waves.astype(np.float32) + phases.astype(np.float32)).sum(axis=1) / np.sqrt(6)).astype(
        np.float32
    )


def _tone(ramp: ndarray, position: float) -> ndarray:
    place = np.clip(position, 0, 1) * (len(ramp) - 1)
    return np.array([np.interp(place, np.arange(len(ramp)), ramp[:, channel]) for channel in range(3)])
