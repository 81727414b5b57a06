"""Random variation of a training sample: crop, gamma and colour balance, the same for picture and maps.

One implementation for render time and training time. The turned or enlarged crop moves pixels only: PNCC and offset
are in the model frame and keep their values.

Source: Crispell and Bazik 2017, Sec. 3.2; ranges of the authors' code.
Deviation from the authors' code: gamma acts on [0, 1]; there it acted on 0 to 255.
"""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8
from numpy import ndarray

from pix2face.crops import Crop, FaceBox, centres_to_integers, crop_image, square_crop
from pix2face.face_maps import FaceMaps

# Where the nose hides a cheek or the ear the scalp, the surface jumps by more than this over two pixels. Smooth
# surface seen at a grazing angle often changes by 10 mm: there blending is several times more accurate than copying.
STEP_MM = 20.0
BEYOND_ALL_MM = 1e4


@final
@dataclass(frozen=True)
class JitterRange:
    """How far samples are varied. The defaults are those of the paper's authors.

    Attributes:
        scale: Least and largest side of the crop, as a multiple of the face box's longer side.
        shift: Largest displacement of the centre, as a fraction of the longer side.
        rotation_deg: Largest turn either way.
        gamma: Least and largest exponent on [0, 1].
        gain: Least gain of a channel relative to the strongest one.
    """

    scale: tuple[float, float] = (1.0, 1.8)
    shift: float = 0.25
    rotation_deg: float = 20.0
    gamma: tuple[float, float] = (0.8, 1.2)
    gain: float = 0.8


@final
@dataclass(frozen=True)
class JitterParameters:
    """One draw.

    Attributes:
        scale: Side of the crop as a multiple of the face box's longer side.
        shift: Displacement of the crop's centre as a fraction of the longer side, (right, down).
        rotation: Radians; positive turns the content anticlockwise as seen.
        gamma: Exponent on [0, 1].
        gains: Factors of red, green and blue, the largest of them 1.
    """

    scale: float
    shift: tuple[float, float]
    rotation: float
    gamma: float
    gains: tuple[float, float, float]


def draw_jitter(rng: np.random.Generator, limits: JitterRange) -> JitterParameters:
    """Draws each quantity evenly from its range."""
    gains = rng.uniform(limits.gain, 1, 3)
    shift = rng.uniform(-limits.shift, limits.shift, 2)
    red, green, blue = (float(gain) for gain in gains / gains.max())
    return JitterParameters(
        scale=float(rng.uniform(*limits.scale)),
        shift=(float(shift[0]), float(shift[1])),
        rotation=float(np.deg2rad(rng.uniform(-limits.rotation_deg, limits.rotation_deg))),
        gamma=float(rng.uniform(*limits.gamma)),
        gains=(red, green, blue),
    )


def jitter_crop(box: FaceBox, jitter: JitterParameters, size_px: int) -> Crop:
    """The crop that a draw takes of a face."""
    return square_crop(box, jitter.scale, size_px, shift=jitter.shift, rotation=jitter.rotation)


def jitter_image(image: UInt8[ndarray, "h w 3"], crop: Crop, jitter: JitterParameters) -> Float32[ndarray, "s s 3"]:
    """Crops a picture and varies its colours.

    Args:
        image: RGB.
        crop: Where to look; beyond the border it is black.
        jitter: Gamma and gains; its scale, shift and rotation are already in ``crop``.

    Returns:
        RGB in [0, 1].
    """
    levels = np.linspace(0, 1, 256) ** jitter.gamma
    table = np.outer(levels, jitter.gains).astype(np.float32)
    return np.asarray(cv2.LUT(crop_image(image, crop), table[None]), dtype=np.float32)


def crop_maps(maps: FaceMaps, crop: Crop) -> FaceMaps:
    """Resamples maps into a crop.

    A pixel is valid where more than half of the weight of its four neighbours is. Its value is their blend, weighted
    by the mask so that no background flows in. Next to a step of the surface it takes the nearest pixel's value
    instead: a blend of two sides of a fold is a point of neither.

    Maps are sampled at pixel centres like rendered ones, also where the crop is coarser than they are.
    """
    weight = _warp(maps.mask.astype(np.float32), crop, cv2.INTER_LINEAR)
    nearest_mask = _warp(maps.mask.astype(np.uint8), crop, cv2.INTER_NEAREST) > 0
    beside_step = _warp(_steps(maps).astype(np.uint8), crop, cv2.INTER_NEAREST) > 0
    mask = np.where(beside_step, nearest_mask, weight > 0.5)
    share = mask / np.maximum(weight, np.float32(0.5))
    copied = mask & beside_step
    pncc, offset = (_resampled(values, crop, share, copied) for values in (maps.pncc, maps.offset))
    return FaceMaps(pncc, offset, mask)


def _steps(maps: FaceMaps) -> Bool[ndarray, "h w"]:
    """Pixels whose 3x3 neighbourhood holds a step of PNCC; background does not count."""
    outside = ~maps.mask[..., None]
    kernel = np.ones((3, 3), dtype=np.uint8)
    highest = cv2.dilate(np.where(outside, np.float32(-BEYOND_ALL_MM), maps.pncc), kernel)
    lowest = cv2.erode(np.where(outside, np.float32(BEYOND_ALL_MM), maps.pncc), kernel)
    x, y, z = cv2.split(highest - lowest)
    return np.asarray(np.maximum(np.maximum(x, y), z) > STEP_MM)


def _resampled(
    values: Float32[ndarray, "h w 3"],
    crop: Crop,
    share: Float32[ndarray, "s s"],
    copied: Bool[ndarray, "s s"],
) -> Float32[ndarray, "s s 3"]:
    """The blend of four pixels over the share of them that is valid, or the nearest pixel where ``copied``."""
    blended = _warp(values, crop, cv2.INTER_LINEAR) * share[..., None]
    if copied.any():
        blended[copied] = _warp(values, crop, cv2.INTER_NEAREST)[copied]
    return blended


def _warp(values: ndarray, crop: Crop, interpolation: int) -> ndarray:
    matrix = centres_to_integers(crop.crop_from_image[:2])
    return np.asarray(
        cv2.warpAffine(
            values, matrix, (crop.size_px, crop.size_px), flags=interpolation, borderMode=cv2.BORDER_CONSTANT
        )
    )
