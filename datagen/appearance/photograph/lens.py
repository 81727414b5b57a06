"""The effects of a lens on linear light, and defocus blur."""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32
from numpy import ndarray


@final
@dataclass(frozen=True, kw_only=True)
class Lens:
    """A lens, its focus and its motion. Lengths are shares of the picture's longer side."""

    defocus: float = 0.0  # radius of the blur disc
    motion: float = 0.0  # length of the motion during the exposure
    motion_deg: float = 0.0  # direction: 0 right, 90 down
    motion_bend: float = 0.0  # height of the path's bend over its length
    magnification: float = 0.0  # magnification of red relative to green, minus 1; that of blue is opposite
    vignetting: float = 0.0  # loss of light at the corner farthest from the axis, 0 to 1
    axis: tuple[float, float] = (0.0, 0.0)  # place of the optical axis, (right, down) from the picture's centre
    bloom: float = 0.0  # share of the light that is scattered near its source
    glare: float = 0.0  # share of the light that is scattered evenly over the picture


def expose_through(lens: Lens, light: Float32[ndarray, "h w 3"]) -> Float32[ndarray, "h w 3"]:
    """Returns the light on the sensor."""
    side = max(light.shape[:2])
    if lens.magnification:
        light = _magnified(light, lens)
    if lens.defocus * side > 0.3:  # px; a smaller blur is hardly visible
        light = _filtered(light, disc(lens.defocus * side))
    if lens.motion * side > 1:
        light = _filtered(light, _path(lens.motion * side, lens.motion_deg, lens.motion_bend))
    if lens.bloom:
        light = _with_bloom(light, lens.bloom)
    if lens.glare:
        light = cv2.add(cv2.multiply(light, (1 - lens.glare,) * 4), tuple(lens.glare * v for v in cv2.mean(light)))  # type: ignore[call-overload] # OpenCV's stubs know no scalars
    if lens.vignetting:
        light = cv2.multiply(light, cv2.merge([_vignette(lens, light.shape[0], light.shape[1])] * 3))
    return light


def _filtered(light: Float32[ndarray, "h w 3"], kernel: Float32[ndarray, "k k"]) -> Float32[ndarray, "h w 3"]:
    return cv2.filter2D(light, -1, kernel, borderType=cv2.BORDER_REFLECT_101)


def disc(radius_px: float, margin_px: float = 0.0) -> Float32[ndarray, "k k"]:
    """Returns the kernel of a disc with a sum of 1 and a smooth edge, and zeros around it up to a margin."""
    reach = int(np.ceil(radius_px + margin_px))
    squares = np.arange(-reach, reach + 1, dtype=np.float32) ** 2
    kernel = np.clip(radius_px + 0.5 - np.sqrt(squares[:, None] + squares), 0, 1)
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)


def _path(length_px: float, direction_deg: float, bend: float) -> Float32[ndarray, "k k"]:
    """Returns the kernel of motion along a parabola, with a sum of 1 and bilinear weights."""
    reach = int(np.ceil(length_px / 2)) + 1
    place = np.linspace(-0.5, 0.5, 4 * reach + 1)
    cos, sin = np.cos(np.deg2rad(direction_deg)), np.sin(np.deg2rad(direction_deg))
    along, across = length_px * place, length_px * bend * (4 * place**2 - 1 / 3) / 2
    x = np.clip(reach + cos * along - sin * across, 0, 2 * reach - 1e-6)
    y = np.clip(reach + sin * along + cos * across, 0, 2 * reach - 1e-6)
    column, row = x.astype(int), y.astype(int)
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.float32)
    for down, below in ((0, 1 - y % 1), (1, y % 1)):
        for right, beside in ((0, 1 - x % 1), (1, x % 1)):
            np.add.at(kernel, (row + down, column + right), (beside * below).astype(np.float32))
    return kernel / kernel.sum()


def _magnified(light: Float32[ndarray, "h w 3"], lens: Lens) -> Float32[ndarray, "h w 3"]:
    height, width = light.shape[:2]
    centre = np.array([width, height]) / 2 - 0.5 + np.asarray(lens.axis) * max(height, width)
    channels = list(cv2.split(light))
    for index, scale in ((0, 1 + lens.magnification), (2, 1 - lens.magnification)):
        matrix = np.array([[scale, 0, (1 - scale) * centre[0]], [0, scale, (1 - scale) * centre[1]]])
        channels[index] = cv2.warpAffine(channels[index], matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return cv2.merge(channels)


def _with_bloom(light: Float32[ndarray, "h w 3"], share: float) -> Float32[ndarray, "h w 3"]:
    height, width = light.shape[:2]
    small = cv2.resize(light, (max(width // 4, 1), max(height // 4, 1)), interpolation=cv2.INTER_AREA)
    glow = cv2.GaussianBlur(small, (0, 0), max(max(height, width) / 64, 0.5))
    glow = cv2.resize(glow, (width, height), interpolation=cv2.INTER_LINEAR)
    return cv2.addWeighted(light, 1 - share, glow, share, 0)


def _vignette(lens: Lens, height: int, width: int) -> Float32[ndarray, "h w"]:
    """Returns the gain of each pixel by the cosine-fourth law, scaled to the vignetting at the farthest corner."""
    side = max(height, width)
    x = (np.arange(width, dtype=np.float32) + 0.5 - width / 2) / side - np.float32(lens.axis[0])
    y = (np.arange(height, dtype=np.float32) + 0.5 - height / 2) / side - np.float32(lens.axis[1])
    squared = y[:, None] ** 2 + x**2
    strength = (1 / np.sqrt(1 - min(lens.vignetting, 0.95)) - 1) / squared.max()
    return np.asarray((1 + np.float32(strength) * squared) ** -2, dtype=np.float32)


def defocused(picture: Float32[ndarray, "h w c"], radius_px: float) -> Float32[ndarray, "h w c"]:
    """Blurs linear light with a disc. A radius below 0.4 px changes nothing."""
    if radius_px < 0.4:
        return picture
    height, width = picture.shape[:2]
    # For speed, discs of more than 3 px are applied to a smaller picture.
    factor = max(1.0, radius_px / 3.0)
    size = max(2, round(width / factor)), max(2, round(height / factor))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if factor > 1 else picture
    blurred = cv2.filter2D(small, -1, disc(radius_px / factor, 0.5), borderType=cv2.BORDER_REPLICATE)
    if factor > 1:
        blurred = cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(blurred, dtype=np.float32)
