"""A sample into its place of a batch: the part of it that is taken, mirrored or not, its colours varied.

Two ways. ``resample`` turns and scales as the paper does, a sample at a time with linear interpolation; for sets of
whole photographs. ``cut`` takes a square of whole pixels out of pictures that were made as crops of faces, or cut to
one (``box_cut``), and moves bytes only: fifteen times as fast.
"""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Int16, Shaped, UInt8
from numpy import ndarray

from pix2face.geometry.crops import Crop, crop_image
from pix2face.geometry.jitter import JitterParameters, crop_maps
from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM, FaceMaps, fixed_point_to_maps
from training.data.decoded_sample import DecodedSample

LARGEST_BYTE = 255


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class BatchRow:
    """The place of one sample in the arrays of a batch; all 0 before it is filled.

    Attributes:
        image: RGB.
        pncc: Steps.
        offset: Steps.
        mask: 0 and 1.
        seen: 0 and 1; None where not all sets know.
    """

    image: UInt8[ndarray, "s s 3"]
    pncc: Int16[ndarray, "s s 3"]
    offset: Int16[ndarray, "s s 3"]
    mask: UInt8[ndarray, "s s"]
    seen: UInt8[ndarray, "s s"] | None

    @property
    def size_px(self) -> int:
        """Side of the square."""
        return len(self.image)


def cut(sample: DecodedSample, corner: tuple[int, int], row: BatchRow, *, mirror: bool) -> None:
    """Fills a row with a square of a picture.

    Args:
        sample: At least as large as the row.
        corner: Column and row of the square's first pixel.
        row: Where to.
        mirror: Whether left and right change places.
    """
    left, top = corner
    picture = sample.image[top : top + row.size_px, left : left + row.size_px]
    row.image[:] = cv2.flip(picture, 1) if mirror else picture
    planes = ((sample.pncc, row.pncc), (sample.offset, row.offset), (sample.mask, row.mask), (sample.seen, row.seen))
    for source, target in planes:
        if source is not None and target is not None:
            _paste(source, (sample.corner[0] - left, sample.corner[1] - top), target, mirror=mirror)
    if mirror:
        for steps in (row.pncc, row.offset):
            np.negative(steps[..., 0], out=steps[..., 0])


def resample(sample: DecodedSample, crop: Crop, row: BatchRow) -> None:
    """Fills a row with a crop, which may turn, scale and mirror.

    Args:
        sample: Of any size.
        crop: Of its picture, of the row's size.
        row: Where to.
    """
    row.image[:] = crop_image(sample.image, crop)
    crop = _moved(crop, sample.corner)
    maps = crop_maps(
        FaceMaps(fixed_point_to_maps(sample.pncc), fixed_point_to_maps(sample.offset), sample.mask.astype(bool)), crop
    )
    for values, target in ((maps.pncc, row.pncc), (maps.offset, row.offset)):
        np.rint(values * np.float32(FIXED_POINT_STEPS_PER_MM), out=target, casting="unsafe")
    row.mask[:] = maps.mask
    if row.seen is not None and sample.seen is not None and sample.seen.size:
        np.minimum(crop_image(sample.seen, crop, nearest=True), row.mask, out=row.seen)


def vary_colours(image: UInt8[ndarray, "s s 3"], jitter: JitterParameters) -> None:
    """Applies the gamma and gains of a draw to a picture in place: a look-up for each byte."""
    table = np.rint(jitter.colour_table * LARGEST_BYTE).astype(np.uint8)
    cv2.LUT(image, table[None], dst=image)


def _paste(
    source: Shaped[ndarray, "y x *c"],
    corner: tuple[int, int],
    target: Shaped[ndarray, "s s *c"],
    *,
    mirror: bool,
) -> None:
    """Copies what of ``source``, whose first pixel is to be at ``corner`` (column, row), lies within ``target``."""
    size_px = len(target)
    left, top = max(corner[0], 0), max(corner[1], 0)
    right, bottom = min(corner[0] + source.shape[1], size_px), min(corner[1] + source.shape[0], size_px)
    if left >= right or top >= bottom:
        return
    part = source[top - corner[1] : bottom - corner[1], left - corner[0] : right - corner[0]]
    if mirror:
        part, left, right = cv2.flip(part, 1).reshape(part.shape), size_px - right, size_px - left
    target[top:bottom, left:right] = part


def _moved(crop: Crop, corner: tuple[int, int]) -> Crop:
    """The same crop in the frame of a picture whose origin is at ``corner``."""
    image_from_crop = crop.image_from_crop.copy()
    image_from_crop[:2, 2] -= corner
    return Crop(image_from_crop, crop.size_px)
