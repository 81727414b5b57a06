"""A sample cut once around its face's box: what ``--cropping box`` keeps, and cuts its squares of whole pixels from.

Boxes of detectors are moved close to those of landmarks (``pix2face.photographs.refined_detection``) before the network
reads them. So the size and place of a face in its crop are known to a few percent, and a network that has seen little
else need not find them out. The rest of the samples teach it what to make of the first box, which a detector drew.

Deviation from the paper: which takes a crop of another scale, place and turn for each draw.
"""

from dataclasses import replace

import numpy as np
from numpy import ndarray

from pix2face.geometry.crops import FaceBox, square_crop
from pix2face.geometry.maps import face_box
from training.data.batch_rows import BatchRow, resample
from training.data.decoded_sample import DecodedSample

# Room for the squares: they lie within half of it around the middle, 5 % of the face's box for a crop of 1.5 boxes.
MARGIN_SHARE = 1 / 16
# Boxes are larger or smaller by as much, evenly; a sample's own box is always so by the same factor.
SIZE_SPREAD = 0.08
# A first box by a detector is farther off: of so many samples by as much in size, and in place in units of the box.
ROUGH_SHARE, ROUGH_SIZE_SPREAD, ROUGH_SHIFT = 0.25, 0.30, 0.15
_BOX_STREAM = 0xB0C5


def cut_around_box(sample: DecodedSample, number: int, size_px: int, crop_scale: float) -> DecodedSample:
    """Resamples a sample to a square around its face.

    Args:
        sample: Of any size; its landmarks have a box.
        number: Of the sample in its set, which decides by how much its box is changed.
        size_px: Side of the squares to be cut from it; that of the result is larger by ``MARGIN_SHARE``.
        crop_scale: Side of those, in units of the longer side of the box.
    """
    side_px = size_px + round(size_px * MARGIN_SHARE)
    rng = np.random.default_rng([_BOX_STREAM, number])
    is_rough = rng.random() < ROUGH_SHARE
    spread = ROUGH_SIZE_SPREAD if is_rough else SIZE_SPREAD
    scale = crop_scale * rng.uniform(1 - spread, 1 + spread) * side_px / size_px
    right, down = rng.uniform(-ROUGH_SHIFT, ROUGH_SHIFT, 2) if is_rough else (0.0, 0.0)
    crop = square_crop(FaceBox.around(sample.landmarks2d), scale, side_px, shift=(float(right), float(down)))
    row = _empty_row(side_px, has_seen=sample.seen is not None)
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


def _empty_row(side_px: int, *, has_seen: bool) -> BatchRow:
    def plane(dtype: type, *channels: int) -> ndarray:
        return np.zeros((side_px, side_px, *channels), dtype)

    return BatchRow(
        image=plane(np.uint8, 3),
        pncc=plane(np.int16, 3),
        offset=plane(np.int16, 3),
        mask=plane(np.uint8),
        seen=plane(np.uint8) if has_seen else None,
    )
