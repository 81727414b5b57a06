"""From a sample to its row of a batch: crops the picture and its maps, mirrors them, and varies the colours.

``resample`` turns and scales as the paper does, with linear interpolation. It is for sets of whole photographs. ``cut``
takes a square of whole pixels from a picture that was made as a crop of a face, or that ``cut_around_box`` has cut to
one. It only moves bytes and is fifteen times as fast.
"""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Shaped, UInt8
from numpy import ndarray

from pix2face.geometry.crops import Crop, FaceBox, crop_image, square_crop
from pix2face.geometry.jitter import JitterParameters, crop_maps
from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM, FaceMaps, face_box, fixed_point_to_maps
from pix2face.models.mirroring import mirrored_landmarks
from training.data.batches import LARGEST_BYTE, batch_row, empty_batch
from training.data.decoded_sample import DecodedSample

# Room for the squares: they lie within half of it around the middle, 5 % of the face's box for a crop of 1.5 boxes.
MARGIN_SHARE = 1 / 16
# Boxes are larger or smaller by as much, evenly; a sample's own box is always so by the same factor.
SIZE_SPREAD = 0.08
# A first box by a detector is farther off: of so many samples by as much in size, and in place in units of the box.
ROUGH_SHARE, ROUGH_SIZE_SPREAD, ROUGH_SHIFT = 0.25, 0.30, 0.15
_BOX_STREAM = 0xB0C5


def cut(sample: DecodedSample, corner: tuple[int, int], row: DecodedSample, *, mirror: bool) -> None:
    """Fills a row with a square of a sample that is at least as large.

    ``corner`` is the column and the row of the square's first pixel. ``mirror`` exchanges left and right.
    """
    left, top = corner
    picture = sample.image[top : top + len(row.image), left : left + len(row.image)]
    row.image[:] = cv2.flip(picture, 1) if mirror else picture
    planes = ((sample.pncc, row.pncc), (sample.offset, row.offset), (sample.mask, row.mask), (sample.seen, row.seen))
    for source, target in planes:
        if source is not None and target is not None:
            _paste(source, (sample.corner[0] - left, sample.corner[1] - top), target, mirror=mirror)
    if mirror:
        for steps in (row.pncc, row.offset):
            np.negative(steps[..., 0], out=steps[..., 0])
    if row.landmarks2d.size:
        landmarks = sample.landmarks2d - corner
        if mirror:
            landmarks = mirrored_landmarks(landmarks * (-1, 1) + (len(row.image), 0))
        row.landmarks2d[:] = landmarks


def resample(sample: DecodedSample, crop: Crop, row: DecodedSample) -> None:
    """Fills a row with a crop of a sample; the crop has the size of the row, and may turn, scale and mirror."""
    row.image[:] = crop_image(sample.image, crop)
    whole, crop = crop, _moved(crop, sample.corner)
    maps = crop_maps(
        FaceMaps(fixed_point_to_maps(sample.pncc), fixed_point_to_maps(sample.offset), sample.mask.astype(bool)), crop
    )
    for values, target in ((maps.pncc, row.pncc), (maps.offset, row.offset)):
        np.rint(values * np.float32(FIXED_POINT_STEPS_PER_MM), out=target, casting="unsafe")
    row.mask[:] = maps.mask
    if row.landmarks2d.size:
        landmarks = whole.to_crop(sample.landmarks2d)
        row.landmarks2d[:] = mirrored_landmarks(landmarks) if whole.is_mirrored else landmarks
    if row.seen is not None and sample.seen is not None and sample.seen.size:
        np.minimum(crop_image(sample.seen, crop, nearest=True), row.mask, out=row.seen)


def vary_colours(image: UInt8[ndarray, "s s 3"], jitter: JitterParameters) -> None:
    """Applies the gamma and gains of a draw to a picture in place: a look-up for each byte."""
    table = np.rint(jitter.colour_table * LARGEST_BYTE).astype(np.uint8)
    cv2.LUT(image, table[None], dst=image)


def cut_around_box(sample: DecodedSample, number: int, size_px: int, crop_scale: float) -> DecodedSample:
    """Resamples a sample to a square around its face, which is larger than ``size_px`` by ``MARGIN_SHARE``.

    Args:
        sample: Its landmarks must have a box.
        number: Of the sample in its set; it decides by how much the box is changed.
        size_px: Side of the squares that will be cut from the result.
        crop_scale: Side of these squares, in units of the longer side of the box.
    """
    side_px = size_px + round(size_px * MARGIN_SHARE)
    rng = np.random.default_rng([_BOX_STREAM, number])
    is_rough = rng.random() < ROUGH_SHARE
    spread = ROUGH_SIZE_SPREAD if is_rough else SIZE_SPREAD
    scale = crop_scale * rng.uniform(1 - spread, 1 + spread) * side_px / size_px
    right, down = rng.uniform(-ROUGH_SHIFT, ROUGH_SHIFT, 2) if is_rough else (0.0, 0.0)
    crop = square_crop(FaceBox.around(sample.landmarks2d), scale, side_px, shift=(float(right), float(down)))
    row = batch_row(empty_batch(1, side_px, has_seen=sample.seen is not None), 0)
    resample(sample, crop, row)
    face = face_box(row.mask.astype(bool))
    return replace(
        sample,
        image=row.image,
        pncc=np.ascontiguousarray(row.pncc[face]),
        offset=np.ascontiguousarray(row.offset[face]),
        mask=np.ascontiguousarray(row.mask[face]),
        seen=None if row.seen is None else np.ascontiguousarray(row.seen[face]),
        corner=(face[1].start, face[0].start),
        landmarks2d=crop.to_crop(sample.landmarks2d).astype(np.float32),
    )


def _paste(
    source: Shaped[ndarray, "y x *c"], corner: tuple[int, int], target: Shaped[ndarray, "s s *c"], *, mirror: bool
) -> None:
    """Copies the part of ``source`` within ``target``, where its first pixel belongs at ``corner`` (column, row)."""
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
