"""A sheet of cases, the worst or the best: each face with its true and its fitted landmarks and its error."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace
from pix2face.evaluation.evaluator import FaceResult
from pix2face.geometry.crops import Crop, FaceBox, crop_image, square_crop
from pix2face.geometry.landmarks import CLOSED_GROUPS, IBUG68_GROUPS

TILE_PX = 280
CAPTION_PX = 40
COLUMNS = 4
CROP_SCALE = 1.8  # wide enough to show where a fit went instead
TRUE_RGB, FOUND_RGB = (40, 220, 40), (240, 40, 40)
CAPTION_CHARACTERS = 40
UNREADABLE_GREY = 128
# OpenCV draws with integer coordinates that carry this many fractional bits.
SHIFT_BITS = 4


def cases_sheet(cases: Sequence[tuple[BenchmarkFace, FaceResult]]) -> UInt8[ndarray, "h w 3"]:
    """A picture of tiles in the order of the cases; green are true landmarks, red found ones."""
    tiles = [_tile(face, result) for face, result in cases]
    columns = min(COLUMNS, max(len(tiles), 1))
    blank = np.full((TILE_PX + CAPTION_PX, TILE_PX, 3), 255, dtype=np.uint8)
    tiles += [blank] * (-len(tiles) % columns or columns * (not tiles))
    rows = [np.hstack(tiles[start : start + columns]) for start in range(0, len(tiles), columns)]
    return np.vstack(rows)


def draw_outlined_landmarks(
    image: UInt8[ndarray, "h w 3"], landmarks2d: Float[ndarray, "68 2"], colour: tuple[int, int, int]
) -> None:
    """Draws the 68 landmarks with their contours into a picture."""
    # Centres at +0.5 become OpenCV's integers at centres.
    fixed = np.rint((np.clip(landmarks2d, -1e4, 1e4) - 0.5) * (1 << SHIFT_BITS)).astype(np.int32)
    for group, indices in IBUG68_GROUPS.items():
        line = fixed[list(indices)].reshape(-1, 1, 2)
        cv2.polylines(image, [line], group in CLOSED_GROUPS, colour, 1, cv2.LINE_AA, SHIFT_BITS)
    for x, y in fixed.tolist():
        cv2.circle(image, (x, y), 2 << SHIFT_BITS, colour, -1, cv2.LINE_AA, SHIFT_BITS)


def _tile(face: BenchmarkFace, result: FaceResult) -> UInt8[ndarray, "h w 3"]:
    crop: Crop = square_crop(FaceBox.around(face.landmarks2d), CROP_SCALE, TILE_PX)
    picture = np.full((TILE_PX, TILE_PX, 3), UNREADABLE_GREY, dtype=np.uint8)
    if face.image is not None:
        picture = crop_image(face.image, crop).copy()
    draw_outlined_landmarks(picture, crop.to_crop(face.landmarks2d), TRUE_RGB)
    if result.landmarks2d is not None:
        draw_outlined_landmarks(picture, crop.to_crop(result.landmarks2d), FOUND_RGB)
    caption = np.full((CAPTION_PX, TILE_PX, 3), 255, dtype=np.uint8)
    error = "not found" if result.failure is not None else f"{100 * result.error():.1f} %"
    yaw = "" if face.yaw_deg is None else f", yaw {face.yaw_deg:.0f}"
    for line, text in enumerate((error + yaw, face.name)):
        _write(caption, text, 15 + 17 * line)
    return np.vstack([picture, caption])


def _write(image: UInt8[ndarray, "h w 3"], text: str, baseline_px: int) -> None:
    drawable = text.encode("ascii", "replace").decode()[:CAPTION_CHARACTERS]  # OpenCV's letters are ASCII
    cv2.putText(image, drawable, (4, baseline_px), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
