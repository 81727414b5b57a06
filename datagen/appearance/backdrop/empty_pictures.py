"""Pictures without people, on which a face detector is trained and its false alarms are measured.

They show environments, generated patterns, drawn animals, and pictures of scikit-image without people. Some of these
are held out: no training picture shows them, so that false alarms can be measured on them.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from datagen.appearance.backdrop.animals import draw_animals
from datagen.appearance.backdrop.patterns import PATTERNS
from datagen.appearance.light.environments import environment_names, panorama_place, picture_panorama
from datagen.appearance.light.light_sources import PanoramaLight, environment_from_camera
from datagen.random_streams import weighted_choice
from pix2face.files.images import linear_to_srgb

# Pictures of scikit-image 0.26 under CC0-1.0 or in the public domain, according to `skimage.data`.
TEXTURES: Final = ("brick", "cell", "clock", "grass", "gravel", "hubble_deep_field", "text")
HELD_OUT_PICTURES: Final = ("cat", "coffee", "page", "rocket")
HELD_OUT_ENVIRONMENTS: Final = ("apartment", "park", "venice", "workshop")
HELD_OUT_PATTERNS: Final = ("shelves", "windows")
KINDS: Final[Mapping[str, float]] = {"environment": 0.42, "pattern": 0.3, "picture": 0.13, "animal": 0.15}  # shares


def draw_empty_picture(rng: np.random.Generator, size_px: int, *, held_out: bool) -> UInt8[ndarray, "s s 3"]:
    """Draws a square picture without people.

    Args:
        rng: Random generator.
        size_px: Side of the picture.
        held_out: Whether to draw only what is held out, or only the rest.
    """
    kinds = {kind: share for kind, share in KINDS.items() if _HELD_OUT[kind] or not held_out}
    kind = weighted_choice(rng, kinds)
    names = [name for name in _NAMES[kind]() if (name in _HELD_OUT[kind]) == held_out]
    name = names[int(rng.integers(len(names)))]
    if kind == "animal":
        picture = draw_animals(rng, size_px, [name for name in sorted(PATTERNS) if name not in HELD_OUT_PATTERNS])
    elif kind == "pattern":
        picture = PATTERNS[name](rng, size_px, size_px)
    elif kind == "environment":
        picture = _environment(rng, name, size_px)
    else:
        picture = _part(rng, _picture(name), size_px)
    return np.ascontiguousarray(picture[:, ::-1] if rng.uniform() < 0.5 else picture)


def _environment(rng: np.random.Generator, name: str, size_px: int) -> UInt8[ndarray, "s s 3"]:
    """Renders an environment in a random direction, most often near the horizon, with its exposure."""
    heading, tilt, roll = rng.uniform(0, 360), rng.normal(0, 20), rng.normal(0, 5)
    light = PanoramaLight(name=name, heading_deg=heading, tilt_deg=tilt, roll_deg=roll, colour_matrix=((1, 0, 0),) * 3)
    half = np.tan(np.deg2rad(rng.uniform(40.0, 140.0)) / 2)  # of the angle of view
    across = (np.arange(size_px) + 0.5) / size_px * 2 - 1
    rays = np.ones((size_px, size_px, 3))
    rays[..., 0], rays[..., 1] = across[None] * half, across[:, None] * half
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    panorama = picture_panorama(name)
    places = panorama_place(rays @ environment_from_camera(light).T, *panorama.shape[:2]).astype(np.float32)
    seen = cv2.remap(panorama, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    exposed = np.maximum(seen, 0) * (0.25 * np.exp(rng.normal(0, 0.5)) / max(float(np.median(seen)), 1e-3))
    return np.rint(255 * linear_to_srgb(np.clip(exposed, 0, 1))).astype(np.uint8)


def _part(rng: np.random.Generator, picture: UInt8[ndarray, "h w 3"], size_px: int) -> UInt8[ndarray, "s s 3"]:
    side = int(min(picture.shape[:2]) * rng.uniform(0.3, 1))
    top, left = (int(rng.integers(extent - side + 1)) for extent in picture.shape[:2])
    part = picture[top : top + side, left : left + side]
    return np.asarray(cv2.resize(part, (size_px, size_px), interpolation=cv2.INTER_AREA), dtype=np.uint8)


@lru_cache(maxsize=16)
def _picture(name: str) -> UInt8[ndarray, "h w 3"]:
    import skimage.data

    picture = np.asarray(getattr(skimage.data, name)())
    return np.ascontiguousarray(np.repeat(picture[..., None], 3, axis=2) if picture.ndim == 2 else picture[..., :3])


_NAMES: Mapping[str, Callable[[], tuple[str, ...]]] = {
    "environment": environment_names,
    "pattern": lambda: tuple(sorted(PATTERNS)),
    "picture": lambda: TEXTURES + HELD_OUT_PICTURES,
    "animal": lambda: ("animal",),
}
_HELD_OUT: Mapping[str, tuple[str, ...]] = {
    "environment": HELD_OUT_ENVIRONMENTS,
    "pattern": HELD_OUT_PATTERNS,
    "picture": HELD_OUT_PICTURES,
    "animal": (),
}
