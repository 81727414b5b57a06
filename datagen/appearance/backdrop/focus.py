"""Blur out of focus: every point becomes a disc, as bright things behind a face do."""

import cv2
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

# Discs are drawn with this radius at most, on a picture made smaller for that: a blurred picture needs no more.
_LARGEST_RADIUS_PX = 3.0


def defocused(picture: Float32[ndarray, "h w c"], radius_px: float) -> Float32[ndarray, "h w c"]:
    """Blurs linear light by a disc; borders are continued. A radius below 0.4 px changes nothing."""
    if radius_px < 0.4:
        return picture
    height, width = picture.shape[:2]
    factor = max(1.0, radius_px / _LARGEST_RADIUS_PX)
    size = max(2, round(width / factor)), max(2, round(height / factor))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if factor > 1 else picture
    blurred = cv2.filter2D(small, -1, disc(radius_px / factor), borderType=cv2.BORDER_REPLICATE)
    if factor > 1:
        blurred = cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(blurred, dtype=np.float32)


def disc(radius_px: float) -> Float32[ndarray, "k k"]:
    """A disc of sum 1 with a smooth edge."""
    reach = int(np.ceil(radius_px + 0.5))
    offsets = np.arange(-reach, reach + 1, dtype=np.float32)
    distance = np.hypot(offsets[:, None], offsets[None])
    kernel = np.clip(radius_px + 0.5 - distance, 0, 1)
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)
