"""Cuts the fibres of irises out of eye textures, without their colour, which each person draws."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from datagen.appearance.skin.skin_textures import IRIS_PX, IRISES, LARGEST_RATIO

# Centre (column, row) and radius in pixels of the upper of the two irises in the 512-pixel textures.
CENTRE_PX, RADIUS_PX = (360.9, 152.4), 58.5
PUPIL = 0.36  # radius of the pupil, which is black in the textures, relative to that of the iris


def pack_irises(folder: Path) -> UInt8[ndarray, "n h w 1"]:
    """Returns the brightness of each iris relative to its mean, encoded as skins are, in the order of ``IRISES``.

    The edge of the iris is the circle inscribed in the square.

    Raises:
        SystemExit: A texture is missing.
    """
    return np.stack([_cut(folder / "HighPolyEyes" / "textures" / f"{name}_eye.png") for name in IRISES])


def _cut(path: Path) -> UInt8[ndarray, "h w 1"]:
    picture = cv2.imread(str(path))
    if picture is None or picture.shape != (512, 512, 3):
        raise SystemExit(f"{path}: expected a picture of 512 x 512 pixels, found {getattr(picture, 'shape', None)}")
    place = (np.arange(IRIS_PX, dtype=np.float32) + 0.5) * np.float32(2 / IRIS_PX) - 1
    x, y = np.meshgrid(place, place)
    column, row = CENTRE_PX[0] - 0.5 + RADIUS_PX * x, CENTRE_PX[1] - 0.5 + RADIUS_PX * y
    light = (cv2.remap(picture, column, row, cv2.INTER_LINEAR) / 255.0).max(axis=2) ** 2.2
    radius = np.hypot(x, y)
    ring = (radius > PUPIL) & (radius < 0.9)
    # The ring is continued to pupil and rim, which the shader darkens.
    filled = cv2.inpaint(_coded(light / light[ring].mean()), np.uint8(~ring), 3, cv2.INPAINT_TELEA)
    return np.asarray(filled[..., None], dtype=np.uint8)


def _coded(ratio: Float64[ndarray, "h w"]) -> UInt8[ndarray, "h w"]:
    return np.asarray(np.clip(255 * np.sqrt(ratio / LARGEST_RATIO) + 0.5, 0, 255), dtype=np.uint8)
