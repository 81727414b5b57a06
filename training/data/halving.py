"""A sample at half its size: pictures are averaged, and maps are taken at the exact centres of the new pixels.

A new pixel is a block of four pixels. Its centre is where their corners meet, and linear interpolation of a map gives
there the mean of the four. There are two exceptions, as in ``pix2face.geometry.jitter.crop_maps``. Pixels outside the
mask do not count; a block is face where three of its pixels are. Where the surface jumps within the block, the value of
one of its pixels is taken, because the mean of two sides of a fold lies on neither.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Int16, Shaped, UInt8
from numpy import ndarray

from pix2face.geometry.jitter import cells_over_steps
from pix2face.geometry.maps import fixed_point_to_maps
from training.data.decoded_sample import DecodedSample

# Of the four pixels of a block.
ENOUGH = 3


def halved(sample: DecodedSample) -> DecodedSample:
    """The sample with two by two pixels merged into one. A last odd row or column is left out."""
    height, width = sample.image.shape[0] // 2, sample.image.shape[1] // 2
    left, top = sample.corner
    # Blocks begin at even rows and columns of the picture, not of the cut.
    edges = ((top % 2, (top + len(sample.mask)) % 2), (left % 2, (left + sample.mask.shape[1]) % 2))
    pncc, offset, mask = (_padded(values, edges) for values in (sample.pncc, sample.offset, sample.mask))
    n_valid = _block_sum(mask)
    is_face = n_valid >= ENOUGH
    copied = is_face
    if mask.size:  # else there is no face, and no cell
        copied = is_face & (cells_over_steps(fixed_point_to_maps(pncc), mask.astype(bool))[::2, ::2] > 0)
    return DecodedSample(
        image=cv2.resize(sample.image[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA),
        pncc=_means(pncc, mask, n_valid, is_face, copied),
        offset=_means(offset, mask, n_valid, is_face, copied),
        mask=is_face.astype(np.uint8),
        seen=None if sample.seen is None else (_block_sum(_padded(sample.seen, edges)) >= ENOUGH).astype(np.uint8),
        corner=(left // 2, top // 2),
        landmarks2d=sample.landmarks2d / 2,
    )


def _means(
    steps: Int16[ndarray, "y x 3"],
    mask: UInt8[ndarray, "y x"],
    n_valid: UInt8[ndarray, "y2 x2"],
    is_face: Bool[ndarray, "y2 x2"],
    copied: Bool[ndarray, "y2 x2"],
) -> Int16[ndarray, "y2 x2 3"]:
    """Of each block the mean of the pixels inside the mask (outside, steps are 0), or the first of them."""
    total = sum(part.astype(np.float32) for part in _quarters(steps))
    share = is_face / np.maximum(n_valid, 1).astype(np.float32)
    means = np.rint(total * share[..., None]).astype(np.int16)
    if copied.any():
        first = np.argmax(np.stack([quarter[copied] for quarter in _quarters(mask)]), axis=0)
        means[copied] = np.stack([quarter[copied] for quarter in _quarters(steps)])[first, np.arange(len(first))]
    return means


def _block_sum(values: UInt8[ndarray, "y x"]) -> UInt8[ndarray, "y2 x2"]:
    a, b, c, d = _quarters(values)
    return a + b + c + d


def _quarters(values: Shaped[ndarray, "y x *c"]) -> Sequence[Shaped[ndarray, "y2 x2 *c"]]:
    """The first, second, third and fourth pixel of each block, row by row."""
    return values[::2, ::2], values[::2, 1::2], values[1::2, ::2], values[1::2, 1::2]


def _padded(
    values: Shaped[ndarray, "y x *c"], edges: tuple[tuple[int, int], tuple[int, int]]
) -> Shaped[ndarray, "yy xx *c"]:
    """Rows and columns of 0 before and after."""
    if not any(map(any, edges)):
        return values
    return np.pad(values, (*edges, *((0, 0) for _ in values.shape[2:])))
