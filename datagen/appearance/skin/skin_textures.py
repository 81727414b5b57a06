"""The textures of `skin.glsl`, packed by `scripts/build_skin_assets.py`, and where things are in them."""

from collections.abc import Mapping
from functools import lru_cache
from importlib.resources import files

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from datagen.appearance.scene import Texture
from pix2face.errors import InputFileError

# The part of MakeHuman's uv square that holds the outside of the head: u from, u to, v from, v to (v upward).
ATLAS_UV = (325 / 512, 1.0, 77 / 512, 417 / 512)
ATLAS_PX = (340, 187)  # height, width: the resolution of the 512-pixel skins
# The part that holds the face, finer: wrinkles and brows.
DETAILS_UV = (0.76, 0.985, 0.315, 0.651)
DETAILS_PX = (516, 346)
# A skin is stored relative to its own mean colour (linear): byte = 255 sqrt(ratio / LARGEST_RATIO).
LARGEST_RATIO = 2.25
# The gradient of the wrinkles' depth, per mm, that the bytes 0 and 255 stand for.
LARGEST_GRADIENT = 1.0
NOISE_PX, IRIS_PX = 256, 96

AGES = ("young", "middleage", "old")
ORIGINS = ("african", "asian", "caucasian")
SEXES = ("female", "male")
SKINS = tuple(f"{age}_{origin}_{sex}" for age in AGES for origin in ORIGINS for sex in SEXES)
IRISES = ("blue", "bluegreen", "brown", "brownlight", "deepblue", "green", "grey", "ice", "lightblue")


@lru_cache(maxsize=1)
def skin_textures() -> Mapping[str, Texture]:
    """The textures of `skin.glsl` by the names of their samplers.

    Raises:
        InputFileError: A file of the package is damaged.
    """
    sizes = {
        "skin_atlas": ATLAS_PX,
        "skin_details": DETAILS_PX,
        "skin_noise": (NOISE_PX,) * 2,
        "skin_iris": (IRIS_PX,) * 2,
    }
    return {name: Texture(pixels=_layers(name, *size), repeat=name == "skin_noise") for name, size in sizes.items()}


def _layers(name: str, height: int, width: int) -> UInt8[ndarray, "n h w c"]:
    data = np.frombuffer((files("datagen") / "assets" / f"{name}.png").read_bytes(), dtype=np.uint8)
    decoded = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if decoded is None:
        raise InputFileError(f"datagen/assets/{name}.png: expected a picture, found a damaged file; install again")
    picture = np.atleast_3d(np.asarray(decoded, dtype=np.uint8))
    n_channels = picture.shape[2]
    rgba = picture if n_channels == 1 else np.take(picture, [2, 1, 0, 3][:n_channels], axis=2)
    return np.ascontiguousarray(rgba.reshape(-1, height, width, n_channels))
