"""Where beards of each style grow, and their strands, as textures over the lower face.

The lower face is unrolled about a point inside the jaw: u is the angle around it from the right ear over the front to
the left one, v the angle down from the cheekbones to the throat.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray

from datagen.appearance.accessories.head_fit import Anchors, anchors_outward
from datagen.appearance.scene import Texture
from pix2face.models.morphable_model import MorphableModel, builtin_model

BEARD_STRANDS = "accessory_beards"
LEVELS = 3  # layers of a style: dense at the skin, sparse at the tips
WIDTH, HEIGHT = 256, 192
ROWS, COLUMNS = 26, 49

_CENTRE = np.array([0.0, -28.0, 38.0])
_AROUND_DEG, _TOP_DEG, _BOTTOM_DEG = 122.0, 48.0, -84.0


@lru_cache(maxsize=4)
def beard_anchors(model: MorphableModel) -> Anchors:
    """The grid of the unrolled lower face on a model, rows from the top."""
    around = np.deg2rad(np.linspace(-_AROUND_DEG, _AROUND_DEG, COLUMNS))[None]
    rise = np.deg2rad(np.linspace(_TOP_DEG, _BOTTOM_DEG, ROWS))[:, None]
    directions = [np.cos(rise) * np.sin(around), np.sin(rise) + 0 * around, np.cos(rise) * np.cos(around)]
    return anchors_outward(model, _CENTRE, np.stack(directions, axis=-1).reshape(-1, 3))


@lru_cache(maxsize=1)
def beard_textures() -> Mapping[str, Texture]:
    """All styles, ``LEVELS`` layers each: grey, alpha, direction of the strands, as ``hair.glsl`` takes them."""
    layers = [_layer(density, level) for density in style_densities().values() for level in range(LEVELS)]
    return {BEARD_STRANDS: Texture(pixels=np.stack(layers))}


def beard_layer(style: str, level: int) -> int:
    """Number of a layer."""
    return list(_STYLES).index(style) * LEVELS + level


@lru_cache(maxsize=1)
def style_densities() -> Mapping[str, Float32[ndarray, "h w"]]:
    """How dense each style is over the unrolled face, 0..1."""
    model = builtin_model()
    grid = beard_anchors(model).at(model.mean).reshape(ROWS, COLUMNS, 3)
    columns, rows = np.meshgrid(
        np.linspace(0, COLUMNS - 1, WIDTH, dtype=np.float32), np.linspace(0, ROWS - 1, HEIGHT, dtype=np.float32)
    )
    place = cv2.remap(grid, columns, rows, cv2.INTER_LINEAR)
    x, y, z = np.abs(place[..., 0]), place[..., 1], place[..., 2]
    allowed = _not_lips(x, y, z) * _above_throat(y, z) * _rise(6, 12, np.hypot(x, 0.9 * (y + 12)) - 6 * (z < 90))
    return {
        name: np.asarray(np.clip(style(x, y, z), 0, 1) * allowed, dtype=np.float32) for name, style in _STYLES.items()
    }


def _rise(low: ndarray | float, high: ndarray | float, value: ndarray) -> ndarray:
    """0 below, 1 above, smooth between; the other way round where ``high`` is below ``low``."""
    t = np.clip((value - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def _not_lips(x: ndarray, y: ndarray, z: ndarray) -> ndarray:
    mouth = np.sqrt((x / 27.5) ** 2 + ((y + 43.5) / 10.8) ** 2)
    return np.where(z > 70, _rise(1.0, 1.16, mouth), 1.0)


def _above_throat(y: ndarray, z: ndarray) -> ndarray:
    return _rise(-100, -90, y) * _rise(4, 14, z + 0.45 * np.clip(y + 70, -40, 90))


def _moustache(x: ndarray, y: ndarray, z: ndarray) -> ndarray:
    top = -22.5 - 0.006 * x**2
    return _rise(top + 1, top - 3, y) * _rise(31, 25, x) * _rise(-47, -43, y) * (z > 75)


def _handlebar(x: ndarray, y: ndarray, z: ndarray) -> ndarray:
    ends = _rise(21, 26, x) * _rise(37, 32, x) * _rise(-72, -66, y) * _rise(-34, -38, y)
    return np.maximum(_moustache(x, y, z), ends * (z > 60))


def _chin(x: ndarray, y: ndarray, z: ndarray) -> ndarray:
    wide = 26 - 0.12 * np.maximum(y + 60, 0)
    return _rise(wide + 4, wide - 2, x) * _rise(-53, -58, y) * _rise(44, 54, z)


def _goatee(x: ndarray, y: ndarray, z: ndarray) -> ndarray:
    beside = _rise(22, 25, x) * _rise(36, 31, x) * _rise(-30, -36, y) * (z > 55)
    return np.maximum.reduce([_moustache(x, y, z), _chin(x, y, z), beside])


def _below_cheek(x: ndarray, y: ndarray, drop_mm: float) -> ndarray:
    line = np.interp(x, [0, 24, 42, 56, 64, 70, 74], [-30, -30, -34, -24, -10, 12, 26]) - drop_mm * (x < 64)
    return _rise(line + 3, line - 4, y)


def _whiskers(x: ndarray, y: ndarray, z: ndarray) -> ndarray:
    return _rise(61, 66, x) * _rise(25, 17, y) * _rise(1, 8, z) * _rise(38, 30, z)


def _full(x: ndarray, y: ndarray, z: ndarray) -> ndarray:
    return np.maximum.reduce([_below_cheek(x, y, 0) * _rise(0, 9, z), _moustache(x, y, z), _whiskers(x, y, z)])


def _boxed(x: ndarray, y: ndarray, z: ndarray) -> ndarray:
    return np.maximum.reduce([_below_cheek(x, y, 14) * _rise(0, 9, z), _goatee(x, y, z), _whiskers(x, y, z)])


def _strap(x: ndarray, y: ndarray, z: ndarray) -> ndarray:
    return np.maximum(_below_cheek(x, y, 30) * _rise(-58, -66, y - 0.5 * np.maximum(x - 40, 0)), _whiskers(x, y, z))


def _mutton(x: ndarray, y: ndarray, z: ndarray) -> ndarray:
    cheek = _below_cheek(x, y, 4) * _rise(30, 38, x) * _rise(0, 9, z)
    return np.maximum(cheek, _whiskers(x, y, z))


_STYLES: Mapping[str, Callable[[ndarray, ndarray, ndarray], ndarray]] = {
    "full": _full,
    "boxed": _boxed,
    "goatee": _goatee,
    "chin": _chin,
    "moustache": _moustache,
    "handlebar": _handlebar,
    "strap": _strap,
    "mutton": _mutton,
    "whiskers": _whiskers,
}
STYLES = tuple(_STYLES)


def _layer(density: Float[ndarray, "h w"], level: int) -> UInt8[ndarray, "h w 4"]:
    """Strands run down (along v): noise that is long there and thin across."""
    rng = np.random.default_rng(level)
    noise = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)).astype(np.float32), (0, 0), 0.6, sigmaY=3.0)
    curls = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)).astype(np.float32), (0, 0), 4.0)
    strands = noise / noise.std() + 0.5 * curls / curls.std()
    bar = (-2.0, -0.6, 0.5)[level]
    alpha = np.clip((strands - bar + 2.2 * (density - 0.8)) * 0.8, 0, 1) * _rise(0.02, 0.5, density)
    alpha *= (0.92, 0.85, 0.75)[level]
    grey = np.clip(0.5 + 0.13 * strands + (-0.12, 0.0, 0.1)[level], 0, 1)
    downward = np.zeros_like(grey), np.full_like(grey, 0.5)
    return (np.stack([grey, alpha, *downward], axis=-1) * 255 + 0.5).astype(np.uint8)
