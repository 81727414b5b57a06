"""Random variation of a training sample: crop, gamma, contrast and colour balance, the same for picture and maps.

Rendering and training share this implementation. The turned or enlarged crop moves pixels only: PNCC and offset
are in the model frame and keep their values. Only a mirrored crop changes them: it shows the mirrored face.

Source: Crispell and Bazik 2017, Sec. 3.2; ranges of the authors' code.
Deviation from the authors' code: gamma acts on [0, 1]; there it acted on 0 to 255.
Deviation from the paper: contrast, and mirrored samples, where a range asks for them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, UInt8
from numpy import ndarray

from pix2face.geometry.crops import Crop, FaceBox, centres_to_integers, crop_image, square_crop
from pix2face.geometry.maps import FaceMaps

# Where the nose hides a cheek, a lid the eye or a lip the teeth, the surface jumps from one pixel to the next: by more
# than this, and by more than this many times what it changes on either side of the jump. A limit in mm alone would not
# do: smooth surface seen at a grazing angle changes by 10 mm a pixel, and there blending beats copying; over a lip's
# edge it jumps by 3 mm. Ratios of 2 to 4 and limits of 1 and 2 mm differ by less than a tenth in the mean error.
STEP_MM = 1.0
STEP_RATIO = 3.0

# Skin is about as bright, so a face stays as bright as it was while its contrast changes.
CONTRAST_PIVOT = 0.45


@final
@dataclass(frozen=True)
class JitterRange:
    """How far samples are varied; pairs are the least and the largest value. The defaults are those of the authors."""

    scale: tuple[float, float] = (1.0, 1.8)  # side of the crop as a multiple of the face box's longer side
    shift: float = 0.25  # largest displacement of the centre as a fraction of the longer side
    rotation_deg: float = 20.0  # largest turn either way
    gamma: tuple[float, float] = (0.8, 1.2)  # exponent on [0, 1]
    gain: float = 0.8  # least gain of a channel relative to the strongest one
    contrast: tuple[float, float] = (1.0, 1.0)  # factor of the distance from ``CONTRAST_PIVOT``; the paper has none
    # Every other sample is mirrored (``mirror_obstacle`` tells whether a model allows it). The paper does not do this.
    mirror: bool = False


@final
@dataclass(frozen=True)
class JitterParameters:
    """One draw of what ``JitterRange`` limits."""

    scale: float
    shift: tuple[float, float]  # (right, down)
    rotation: float  # radians; positive turns the content anticlockwise as seen
    gamma: float
    gains: tuple[float, float, float]  # factors of red, green and blue, the largest of them 1
    contrast: float = 1.0  # applied before the gains
    mirror: bool = False

    @property
    def colour_table(self) -> Float64[ndarray, "256 3"]:
        """What each byte of red, green and blue becomes, in [0, 1]."""
        levels = np.linspace(0, 1, 256) ** self.gamma
        levels = np.clip(CONTRAST_PIVOT + self.contrast * (levels - CONTRAST_PIVOT), 0, 1)
        return np.outer(levels, self.gains)


def draw_jitter(rng: np.random.Generator, limits: JitterRange) -> JitterParameters:
    """Draws each quantity evenly from its range (contrast: its logarithm)."""
    gains = rng.uniform(limits.gain, 1, 3)
    shift = rng.uniform(-limits.shift, limits.shift, 2)
    red, green, blue = (float(gain) for gain in gains / gains.max())
    return JitterParameters(
        scale=float(rng.uniform(*limits.scale)),
        shift=(float(shift[0]), float(shift[1])),
        rotation=float(np.deg2rad(rng.uniform(-limits.rotation_deg, limits.rotation_deg))),
        gamma=float(rng.uniform(*limits.gamma)),
        gains=(red, green, blue),
        mirror=limits.mirror and bool(rng.random() < 0.5),
        # Last, so that sets without it are drawn as they always were.
        contrast=1.0 if limits.contrast == (1.0, 1.0) else float(np.exp(rng.uniform(*np.log(limits.contrast)))),
    )


def jitter_crop(box: FaceBox, jitter: JitterParameters, size_px: int) -> Crop:
    """The crop of a face for one draw."""
    return square_crop(box, jitter.scale, size_px, shift=jitter.shift, rotation=jitter.rotation, mirror=jitter.mirror)


def jitter_image(image: UInt8[ndarray, "h w 3"], crop: Crop, jitter: JitterParameters) -> Float32[ndarray, "s s 3"]:
    """Crops an RGB picture and varies its colours, which are in [0, 1] then; beyond the border it is black.

    Of the draw, only gamma, contrast and gains are used: scale, shift and rotation are already in ``crop``.
    """
    table = jitter.colour_table.astype(np.float32)
    return np.asarray(cv2.LUT(crop_image(image, crop), table[None]), dtype=np.float32)


def crop_maps(maps: FaceMaps, crop: Crop) -> FaceMaps:
    """Resamples maps into a crop.

    A pixel is valid where more than half of the weight of its four neighbours is. Its value is their blend, weighted
    by the mask so that no background flows in. Where the surface jumps between the four it takes the nearest pixel's
    value instead: a blend of two sides of a fold is a point of neither.

    Maps are sampled at pixel centres like rendered ones, also where the crop is coarser than they are. A mirrored crop
    shows the mirrored face: the x of PNCC and offset change sign.
    """
    if not maps.mask.size:  # cut to a face that is not there; OpenCV resamples no empty picture
        nothing = np.zeros((1, 1, 3), dtype=np.float32)
        maps = FaceMaps(nothing, nothing, np.zeros((1, 1), dtype=bool))
    weight = _warp(maps.mask.astype(np.float32), crop, cv2.INTER_LINEAR)
    # Value (i, j) stands for the cell between the centres of pixels (i, j) and (i + 1, j + 1), half a pixel further.
    over_step = _warp(cells_over_steps(maps.pncc, maps.mask), crop, cv2.INTER_NEAREST, centre_px=1.0) > 0
    rows, columns, is_inside = _nearest_pixels(over_step, crop, maps.mask.shape)
    is_face = is_inside & maps.mask[rows, columns]
    mask = weight > 0.5
    mask[over_step] = is_face
    partial = mask & (weight < 1)
    share = np.maximum(weight[partial], np.float32(0.5))[:, None]
    resampled: list[Float32[ndarray, "s s 3"]] = []
    for values in (maps.pncc, maps.offset):
        # What is copied by a mask is 0 elsewhere.
        blended = cv2.copyTo(_warp(values, crop, cv2.INTER_LINEAR), mask.view(np.uint8))
        blended[partial] = np.divide(blended[partial], share)
        blended[over_step] = values[rows, columns] * is_face[:, None]
        if crop.is_mirrored:
            np.negative(blended[..., 0], out=blended[..., 0])
        resampled.append(blended)
    return FaceMaps(resampled[0], resampled[1], mask)


def cells_over_steps(pncc: Float32[ndarray, "h w 3"], mask: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w"]:
    """Which cells of four pixel centres the surface jumps in; (i, j) is that of (i, j) to (i + 1, j + 1)."""
    planes = cv2.split(np.ascontiguousarray(pncc))
    across, down = _jumps(planes, mask), _jumps([plane.T for plane in planes], mask.T).T
    cells = np.zeros(mask.shape, dtype=bool)
    cells[:, :-1] = across
    cells[:-1, :-1] |= across[1:] | down[:, 1:]
    cells[:-1] |= down
    return cells.astype(np.uint8)


def _jumps(planes: Sequence[Float32[ndarray, "h w"]], mask: Bool[ndarray, "h w"]) -> Bool[ndarray, "h n"]:
    """Whether the surface jumps between a pixel and the next one of its row (n = w - 1); background does not count."""
    squared = np.square(planes[0][:, 1:] - planes[0][:, :-1])
    for plane in planes[1:]:
        squared += np.square(plane[:, 1:] - plane[:, :-1])
    squared *= mask[:, 1:] & mask[:, :-1]
    beside = np.zeros_like(squared)
    beside[:, 1:] = squared[:, :-1]
    np.maximum(beside[:, :-1], squared[:, 1:], out=beside[:, :-1])
    return np.asarray((squared > STEP_MM**2) & (squared > STEP_RATIO**2 * beside))


def _nearest_pixels(
    chosen: Bool[ndarray, "s s"], crop: Crop, size_px: tuple[int, ...]
) -> tuple[Int64[ndarray, " n"], Int64[ndarray, " n"], Bool[ndarray, " n"]]:
    """Rows and columns of the picture's pixels in which the centres of some of the crop's pixels lie.

    Where they lie beyond its border, the nearest ones there are; the last array says where they do not.
    """
    rows, columns = np.nonzero(chosen)
    points = crop.to_image(np.stack([columns, rows], axis=1) + 0.5)
    found = np.floor(points).astype(np.int64)[:, ::-1]
    nearest = np.clip(found, 0, np.array(size_px) - 1)
    return nearest[:, 0], nearest[:, 1], (found == nearest).all(axis=1)


def _warp(values: ndarray, crop: Crop, interpolation: int, centre_px: float = 0.5) -> ndarray:
    """Values at the pixel centres of the crop; value (i, j) belongs at (j, i) + ``centre_px``."""
    matrix = centres_to_integers(crop.crop_from_image[:2])
    matrix[:, 2] += matrix[:, :2] @ np.full(2, centre_px - 0.5)
    return np.asarray(
        cv2.warpAffine(
            values, matrix, (crop.size_px, crop.size_px), flags=interpolation, borderMode=cv2.BORDER_CONSTANT
        )
    )
