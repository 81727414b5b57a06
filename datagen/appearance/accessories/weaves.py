"""Generated textures of cloth, leather, paper and skin, small and tileable.

Red is the lightness (0.8 shows the colour of the material unchanged), green the share of the second colour, blue the
dullness, alpha the opacity; see `material.glsl`.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.scene import Texture

SIZE = 128
NEUTRAL = 0.8
WEAVES = "accessory_weaves"

Layer = Float32[ndarray, "s s 4"]
# v and u of each texel, 0..1.
_V, _U = np.mgrid[:SIZE, :SIZE].astype(np.float32) / SIZE


def layer_of(weave: str) -> int:
    """Returns the texture layer of a weave."""
    return list(_PAINTERS).index(weave)


@lru_cache(maxsize=1)
def weave_textures() -> Mapping[str, Texture]:
    """Returns the texture of all weaves, one layer each."""
    layers = np.stack([paint() for paint in _PAINTERS.values()])
    return {WEAVES: Texture(pixels=(np.clip(layers, 0, 1) * 255 + 0.5).astype(np.uint8), repeat=True)}


def _layer(
    shade: ndarray | float = 0.0, second: ndarray | float = 0.0, dull: float = 1.0, alpha: ndarray | float = 1.0
) -> Layer:
    """Makes a layer with a lightness of 1 + `shade` relative to neutral."""
    parts = (NEUTRAL * (1 + np.asarray(shade)), second, dull, alpha)
    return np.stack([np.broadcast_to(np.asarray(part, dtype=np.float32), (SIZE, SIZE)) for part in parts], axis=-1)


def _noise(seed: int, blur: float) -> Float32[ndarray, "s s"]:
    """Returns tileable noise of unit standard deviation; `blur` is in texels."""
    noise = np.random.default_rng(seed).standard_normal((SIZE, SIZE)).astype(np.float32)
    wide = cv2.GaussianBlur(np.tile(noise, (3, 3)), (0, 0), blur)[SIZE : 2 * SIZE, SIZE : 2 * SIZE]
    return np.asarray((wide - wide.mean()) / wide.std(), dtype=np.float32)


def _wave(phase: ndarray, sharpness: float = 4.0) -> ndarray:
    """Returns a smooth square wave, 0..1, with period 1."""
    return 0.5 + 0.5 * np.tanh(sharpness * np.sin(2 * np.pi * phase))


def _lines(phase: ndarray, half_width: float) -> ndarray:
    """Returns lines in the middle of each period of 1."""
    return np.abs(phase % 1 - 0.5) < half_width


def _knit() -> Layer:
    stitch = np.abs((_U * 8) % 1 - 0.5) * 2
    rows = 0.16 * np.sin(2 * np.pi * (_V * 16 + 0.35 * stitch)) * (1 - stitch**4)
    return _layer(rows - 0.22 * stitch**4 + 0.03 * _noise(3, 1))


def _linen() -> Layer:
    over = np.sin(2 * np.pi * 16 * _U) * np.sin(2 * np.pi * 16 * _V)
    threads = _noise(5, 0.8).mean(axis=0, keepdims=True) + _noise(6, 0.8).mean(axis=1, keepdims=True)
    return _layer(0.08 * over + 0.25 * threads + 0.03 * _noise(7, 0.7))


def _denim() -> Layer:
    twill = np.sin(2 * np.pi * 16 * (_U + _V))
    return _layer(0.12 * twill + 0.05 * _noise(8, 0.8) + 0.05 * _noise(9, 14), 0.18 + 0.12 * twill)


def _plaid() -> Layer:
    bands = (0.5 * _wave(2 * _U) + 0.5 * _wave(2 * _V)) * 0.8
    thin = (_lines(2 * _U + 0.25, 0.03) | _lines(2 * _V + 0.25, 0.03)) * 0.2
    return _layer(0.04 * np.sin(2 * np.pi * 32 * (_U + _V)) - thin, bands)


def _dots() -> Layer:
    even = np.hypot((4 * _U) % 1 - 0.5, (4 * _V) % 1 - 0.5) < 0.2
    odd = np.hypot((4 * _U + 0.5) % 1 - 0.5, (4 * _V + 0.5) % 1 - 0.5) < 0.2
    return _layer(0.02 * _noise(17, 1), cv2.GaussianBlur((even | odd).astype(np.float32), (0, 0), 0.7))


def _herringbone() -> Layer:
    zigzag = np.abs((4 * _U) % 1 - 0.5) * 2
    return _layer(0.03 * _noise(18, 0.8), 0.5 + 0.4 * np.sin(2 * np.pi * (16 * _V + 2 * zigzag)))


def _flowers() -> Layer:
    second, shade = np.zeros((SIZE, SIZE), dtype=np.float32), 0.03 * _noise(19, 1)
    rng = np.random.default_rng(20)
    for _ in range(14):
        x, y, size, turn = *rng.uniform(size=2), rng.uniform(0.05, 0.12), rng.uniform(0, 6)
        dx, dy = (_U - x + 0.5) % 1 - 0.5, (_V - y + 0.5) % 1 - 0.5
        radius, angle = np.hypot(dx, dy), np.arctan2(dy, dx)
        second = np.maximum(second, radius < size * (0.65 + 0.35 * np.cos(5 * angle + turn)))
        shade = shade - 0.35 * (radius < 0.25 * size)
    return _layer(shade, second)


def _letters(seed: int, lines: int, height: float) -> Float32[ndarray, "s s"]:
    """Draws lines of strokes that resemble words."""
    rng = np.random.default_rng(seed)
    ink = np.zeros((SIZE, SIZE), dtype=np.float32)
    for line in range(lines):
        top, x = int(SIZE * (line + 0.2) / lines), 4.0
        tall = max(2, int(SIZE / lines * height))
        while x < SIZE - 8:
            wide = rng.uniform(0.4, 0.75) * tall
            strokes = rng.integers(1, 4)
            for _ in range(strokes):
                ends = rng.uniform([x, top, x, top], [x + wide, top + tall, x + wide, top + tall]).astype(int)
                cv2.line(ink, ends[:2].tolist(), ends[2:].tolist(), 1.0, max(1, tall // 7))
            x += wide * (1.25 if rng.uniform() < 0.8 else 2.4)
    return ink


def _print() -> Layer:
    ink = _letters(23, 3, 0.6)
    ink[: SIZE // 5], ink[-SIZE // 5 :] = 0, 0
    return _layer(0.03 * _noise(24, 0.8), cv2.GaussianBlur(ink, (0, 0), 0.6))


def _paper() -> Layer:
    ink = _letters(25, 14, 0.5)
    ink[:, :8], ink[:, -8:] = 0, 0
    return _layer(0.01 * _noise(26, 2), 0.9 * ink)


def _pleats() -> Layer:
    fold = (4 * _V) % 1
    return _layer(-0.25 * np.exp(-((fold / 0.1) ** 2)) + 0.08 * fold + 0.02 * _noise(27, 0.6))


def _straw() -> Layer:
    over = np.sin(2 * np.pi * 12 * (_U + _V)) * np.sin(2 * np.pi * 12 * (_U - _V))
    return _layer(0.15 * over + 0.05 * _noise(31, 0.8))


def _lattice() -> Layer:
    wires = np.maximum(_lines(2 * (_U + _V), 0.08), _lines(2 * (_U - _V), 0.08))
    return _layer(0.05 * _noise(36, 2), dull=0.4, alpha=wires)


def _lace() -> Layer:
    net = np.maximum(np.cos(2 * np.pi * 16 * _U), np.cos(2 * np.pi * 16 * _V)) > 0.6
    return _layer(0.0, alpha=np.where(_noise(37, 6) > 1.0, 0.9, 0.22 + 0.3 * net))


def _leaf() -> Layer:
    aside = np.abs(_U - 0.5)
    veins = np.exp(-(((_U - 0.5) / 0.015) ** 2)) + 0.5 * np.exp(-((((8 * (_V + aside)) % 1 - 0.5) / 0.06) ** 2))
    inside = aside < 0.42 * np.sin(np.pi * np.clip(_V, 0, 1)) ** 0.8
    return _layer(0.2 * veins - 0.1 + 0.05 * _noise(38, 4), dull=0.6, alpha=inside)


# The layers of the texture, in this order.
_PAINTERS: Mapping[str, Callable[[], Layer]] = {
    "jersey": lambda: _layer(0.03 * _noise(1, 0.7) + 0.03 * _noise(2, 12)),
    "knit": _knit,
    "rib": lambda: _layer(0.18 * np.cos(2 * np.pi * 8 * _U) + 0.03 * _noise(4, 1)),
    "linen": _linen,
    "denim": _denim,
    "leather": lambda: _layer(0.10 * (0.8 - np.abs(_noise(10, 3))) + 0.04 * _noise(11, 1), dull=0.3),
    "fleece": lambda: _layer(0.13 * _noise(12, 1.6) + 0.06 * _noise(13, 5)),
    "plaid": _plaid,
    "check": lambda: _layer(0.02 * _noise(14, 1), np.maximum(_lines(4 * _U, 0.06), _lines(4 * _V, 0.06)) * 1.0),
    "stripes_across": lambda: _layer(0.03 * _noise(15, 1), _wave(3 * _V, 8)),
    "stripes_along": lambda: _layer(0.03 * _noise(16, 1), _lines(5 * _U, 0.08)),
    "dots": _dots,
    "herringbone": _herringbone,
    "flowers": _flowers,
    "camouflage": lambda: _layer(-0.35 * (_noise(21, 8) > 0.5), _noise(22, 9) > 0.2),
    "print": _print,
    "paper": _paper,
    "pleats": _pleats,
    "skin": lambda: _layer(0.02 * _noise(28, 0.8) + 0.03 * _noise(29, 6) + 0.03 * _noise(30, 16), dull=0.7),
    "straw": _straw,
    "brushed": lambda: _layer(0.5 * _noise(32, 0.8).mean(axis=0, keepdims=True) + 0.02 * _noise(33, 1), dull=0.5),
    "wood": lambda: _layer(0.12 * np.sin(2 * np.pi * (6 * _U + 0.25 * _noise(34, 10))) + 0.04 * _noise(35, 1), 0.2),
    "lattice": _lattice,
    "lace": _lace,
    "leaf": _leaf,
}
