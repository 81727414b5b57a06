"""The maps that the network learns: PNCC (projected normalised coordinate code), offset, and their mask."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int16, UInt8
from numpy import ndarray

from pix2face.geometry.camera import Camera

# Fixed point: rounding to 1/128 mm is at most 0.004 mm off, and int16 reaches to 256 mm.
FIXED_POINT_STEPS_PER_MM = 128
# How far from the face, in pixels of the maps, a point is still taken for one of its border.
REACH_PX = 4
# What the packaged network answers is rough from pixel to pixel, and its offsets come in blocks of four. Means over so
# many of its pixels (standard deviation) are smooth, and nearer to the truth (docs/explanation/packaged_network.md).
SMOOTH_PNCC_PX, SMOOTH_OFFSET_PX, SMOOTH_EDGE_PX = 1.5, 3.0, 1.0


# From the weak-perspective camera (pixels of the maps) and the coefficients (standard deviations) of a fit to those
# that a network takes for nearer to the truth.
FitCorrector = Callable[[Camera, Float64[ndarray, " c"]], tuple[Camera, Float64[ndarray, " c"]]]


@final
@dataclass(frozen=True, eq=False)
class PredictedLandmarks:
    """Where a network sees the landmarks of its model, hidden ones included."""

    points2d: Float64[ndarray, "n 2"]  #: pixels of the maps, centres at +0.5
    #: Scale b of the errors, pixels. Distances from the truth are expected to fall off like exp(-r / b), with mean 2 b.
    scales_px: Float64[ndarray, " n"]


@final
@dataclass(frozen=True, eq=False)
class FaceMaps:
    """Dense correspondence and shape of one picture, in mm, model frame; 0 outside the mask."""

    pncc: Float32[ndarray, "h w 3"]  #: for each pixel, the matching point on the mean face
    offset: Float32[ndarray, "h w 3"]  #: displacement from there to the same point on this face
    mask: Bool[ndarray, "h w"]  #: where PNCC and offset are valid
    #: The part of the mask where the picture shows the face itself and not something in front of it; None if unknown.
    seen: Bool[ndarray, "h w"] | None = None
    #: Where the picture that they belong to shows the photograph that it is a crop of, and is not empty beside it; None
    #: where all of it does.
    in_photograph: Bool[ndarray, "h w"] | None = None
    #: The landmarks of the model in the picture; None if the network predicts maps only.
    landmarks: PredictedLandmarks | None = None
    #: What the network says of a fit to these maps; None if it corrects none.
    correct: FitCorrector | None = None

    @property
    def seen_share(self) -> float | None:
        """The visible fraction of the face; None if unknown."""
        return None if self.seen is None or not self.mask.any() else float(self.seen[self.mask].mean())


def face_box(mask: Bool[ndarray, "h w"]) -> tuple[slice, slice]:
    """Rows and columns of the mask's bounding box; both are empty if the mask is empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def fixed_point_to_maps(values: Int16[ndarray, "*h 3"]) -> Float32[ndarray, "*h 3"]:
    """Converts steps of 1/128 mm to millimetres."""
    return np.multiply(values, np.float32(1 / FIXED_POINT_STEPS_PER_MM), dtype=np.float32)


def valid_pixels(pncc: Float32[ndarray, "h w 3"], smallest_radius_mm: float) -> Bool[ndarray, "h w"]:
    """Which predicted pixels are face: PNCC longer than half the model's smallest radius, then eroded by one pixel.

    The background is 0 and every point of the face is far from the origin, so the threshold lies midway.
    """
    return eroded(np.linalg.norm(pncc, axis=2) > smallest_radius_mm / 2)


def eroded(mask: Bool[ndarray, "h w"]) -> Bool[ndarray, "h w"]:
    """Removes the outermost pixels of a mask, where a network's maps lie between face and background.

    The border of the picture does not count as a border of the face.
    """
    kernel = np.ones((3, 3), dtype=np.uint8)
    return cv2.erode(mask.astype(np.uint8), kernel, borderType=cv2.BORDER_REPLICATE).astype(bool)


def without_holes(mask: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w"]:
    """A mask with its holes, such as an open mouth: 1 inside its outlines, 0 outside."""
    whole = np.zeros(mask.shape, np.uint8)
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(whole, outlines, -1, 1, cv2.FILLED))


def nearest_inside(mask: Bool[ndarray, "h w"]) -> tuple[Float32[ndarray, "h w"], Int[ndarray, "h w"]]:
    """The distance of each pixel from a mask that is not empty, and its nearest pixel (its number in the flat mask)."""
    distance, label = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    pixel_of_label = np.zeros(int(label.max()) + 1, dtype=np.intp)
    pixel_of_label[label[mask]] = np.flatnonzero(mask)
    return distance, pixel_of_label[label]


def smooth_maps(maps: FaceMaps, size_px: int, *, has_holes: bool = True) -> FaceMaps:
    """Predicted maps of a square in another size, without the roughness and the blocks of a network's answers.

    Means are taken over pixels inside the mask alone, and enlarged by cubic interpolation. Without ``has_holes``, holes
    of the mask, such as an open mouth, get the values around them. PNCC, offset and mask are returned.
    """
    if not has_holes and maps.mask.any():
        nearest = nearest_inside(maps.mask)[1]
        pncc, offset = (values.reshape(-1, 3)[nearest] for values in (maps.pncc, maps.offset))
        maps = FaceMaps(pncc, offset, without_holes(maps.mask).astype(bool))
    mask = _enlarged(cv2.GaussianBlur(maps.mask.astype(np.float32), (0, 0), SMOOTH_EDGE_PX), size_px) > 0.5
    pncc, offset = (
        _enlarged(_mean_inside(values, maps.mask, blur_px), size_px)
        for values, blur_px in ((maps.pncc, SMOOTH_PNCC_PX), (maps.offset, SMOOTH_OFFSET_PX))
    )
    pncc[~mask], offset[~mask] = 0, 0
    return FaceMaps(pncc, offset, mask)


def _mean_inside(
    values: Float32[ndarray, "h w 3"], mask: Bool[ndarray, "h w"], blur_px: float
) -> Float32[ndarray, "h w 3"]:
    """Gaussian means of what is inside a mask, also of pixels beside it."""
    weight = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), blur_px)[..., None]
    return cv2.GaussianBlur(values * mask[..., None], (0, 0), blur_px) / np.maximum(weight, np.float32(1e-6))


def _enlarged(values: Float32[ndarray, "h w *c"], size_px: int) -> Float32[ndarray, "s s *c"]:
    return np.asarray(cv2.resize(values, (size_px, size_px), interpolation=cv2.INTER_CUBIC))


def uncovered_points(
    points: Float[ndarray, "m 2"], mask: Bool[ndarray, "h w"], seen: Bool[ndarray, "h w"]
) -> Bool[ndarray, " m"]:
    """Which points of a picture (pixels) nothing covers that is in front of the face, such as a cloth mask or a hand.

    ``mask`` is where the face is and ``seen`` its part that the picture shows (``FaceMaps``). A point is covered where
    the nearest pixels of the face are not seen: points of the jaw lie on the border of the face and a little beyond a
    predicted mask. Farther from the face nothing is known, and points count as uncovered.
    """
    return np.array([_is_uncovered(point, mask, seen) for point in points], dtype=bool)


def _is_uncovered(point: Float[ndarray, "2"], mask: Bool[ndarray, "h w"], seen: Bool[ndarray, "h w"]) -> bool:
    if not (np.abs(point) < max(mask.shape) + REACH_PX).all():  # also NaN
        return True
    column, row = (int(value) for value in np.floor(point))
    for reach in range(1, REACH_PX + 1):
        rows, columns = (slice(max(at - reach, 0), max(at + reach + 1, 0)) for at in (row, column))
        if mask[rows, columns].any():
            return bool(seen[rows, columns].any())
    return True


def point_cloud(
    maps: FaceMaps, image: UInt8[ndarray, "h w 3"]
) -> tuple[Float32[ndarray, "n 3"], UInt8[ndarray, "n 3"]]:
    """The 3D point of every valid pixel (PNCC + offset, mm, model frame) and its colour (RGB)."""
    return maps.pncc[maps.mask] + maps.offset[maps.mask], image[maps.mask]


def map_picture(
    values_mm: Float32[ndarray, "h w 3"], mask: Bool[ndarray, "h w"], limit_mm: float
) -> UInt8[ndarray, "h w 3"]:
    """A map as a picture: x, y, z as red, green, blue from -limit to limit; grey outside the mask."""
    picture = np.clip(values_mm / (2 * limit_mm) + 0.5, 0, 1) * 255
    picture[~mask] = 128
    return picture.astype(np.uint8)
