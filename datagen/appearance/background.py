"""Procedural backgrounds: gradients, smooth noise, blocks and stripes in random colours."""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray


def draw_background(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws a background, sRGB: one pattern over another, out of focus more or less."""
    pictures = [_PATTERNS[int(rng.integers(len(_PATTERNS)))](rng, height, width) for _ in range(2)]
    blend = rng.uniform(0, 0.5)
    picture: ndarray = (1 - blend) * pictures[0] + blend * pictures[1]
    blur = rng.exponential(0.01) * max(height, width)
    if blur > 0.3:
        picture = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), min(blur, 8.0))
    return np.clip(picture * 255, 0, 255).astype(np.uint8)


def _gradient(rng: np.random.Generator, height: int, width: int) -> Float32[ndarray, "h w 3"]:
    corners = rng.uniform(0, 1, size=(2, 2, 3)).astype(np.float32)
    return cv2.resize(corners, (width, height), interpolation=cv2.INTER_LINEAR)


def _smooth_noise(rng: np.random.Generator, height: int, width: int) -> Float32[ndarray, "h w 3"]:
    colours = rng.uniform(0, 1, size=(2, 3)).astype(np.float32)
    total = np.zeros((height, width), dtype=np.float32)
    for octave in range(4):
        cells = 3 * 2**octave
        noise = rng.uniform(0, 1, size=(cells, cells)).astype(np.float32)
        total += cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC) * np.float32(0.5**octave)
    total = (total / 1.875)[..., None]
    return np.asarray(colours[0] * (1 - total) + colours[1] * total, dtype=np.float32)


def _blocks(rng: np.random.Generator, height: int, width: int) -> Float32[ndarray, "h w 3"]:
    picture = np.full((height, width, 3), rng.uniform(0, 1, size=3), dtype=np.float32)
    for _ in range(int(rng.integers(4, 20))):
        x, y = rng.uniform(-0.2, 1, size=2) * [width, height]
        extent = rng.uniform(0.05, 0.7, size=2) * [width, height]
        corners = [(int(x), int(y)), (int(x + extent[0]), int(y + extent[1]))]
        cv2.rectangle(picture, corners[0], corners[1], rng.uniform(0, 1, size=3).tolist(), thickness=-1)
    return picture


def _stripes(rng: np.random.Generator, height: int, width: int) -> Float32[ndarray, "h w 3"]:
    angle, wavelength = rng.uniform(0, np.pi), rng.uniform(0.03, 0.3) * max(height, width)
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    phase = (np.cos(angle) * columns + np.sin(angle) * rows) * np.float32(2 * np.pi / wavelength)
    hardness = rng.uniform(1, 8)
    share = (0.5 + 0.5 * np.tanh(hardness * np.sin(phase)))[..., None]
    colours = rng.uniform(0, 1, size=(2, 3)).astype(np.float32)
    return np.asarray(colours[0] * (1 - share) + colours[1] * share, dtype=np.float32)


_PATTERNS = (_gradient, _smooth_noise, _blocks, _stripes)
