"""The effects of programs, screens, prints and small files on a picture that was taken."""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from datagen.appearance.photograph.sensor import noise_window
from pix2face.files.images import decode_image, encode_photograph

INTERPOLATIONS = {"nearest": cv2.INTER_NEAREST, "linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}


@final
@dataclass(frozen=True, kw_only=True)
class Processing:
    """Processing steps in their order."""

    smoothing: float = 0.0  # strength of skin smoothing, 0..1
    side_px: int = 0  # longer side of a small picture that was enlarged; 0 for none
    enlarged_by: str = "cubic"  # `nearest`, `linear` or `cubic`
    sharpening: float = 0.0  # strength of the haloes
    sharpening_px: float = 1.0  # width of the haloes
    grain: float = 0.0  # standard deviation of film grain, 0 to 255
    scratches: int = 0  # number of scratches from top to bottom
    dust: int = 0  # number of specks and hairs
    interlace: float = 0.0  # shift between odd and even lines, as a share of the width
    moire: float = 0.0  # strength of the moiré pattern of a photographed screen, 0..1
    colours: int = 256  # number of levels of each colour
    text: str = ""  # a date or a watermark over the picture
    text_place: tuple[float, float] = (0.0, 0.0)  # start of the text, as shares of width and height
    text_size: float = 0.0  # height of the letters, as a share of the picture's side
    text_opacity: float = 0.0  # 0..1
    first_quality: int = 0  # quality of an earlier JPEG file of the picture; 0 for none


def process(
    processing: Processing, image: UInt8[ndarray, "h w 3"], rng: np.random.Generator
) -> UInt8[ndarray, "h w 3"]:
    """Applies all steps to a picture."""
    height, width = image.shape[:2]
    if processing.smoothing:
        smooth = cv2.bilateralFilter(image, 5, 40.0, 3.0)
        image = cv2.addWeighted(image, 1 - processing.smoothing, smooth, processing.smoothing, 0)
    if processing.interlace:
        image = _interlaced(image, processing.interlace)
    is_small = 0 < processing.side_px < max(height, width)
    if is_small:
        scale = processing.side_px / max(height, width)
        size = (max(round(width * scale), 1), max(round(height * scale), 1))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    if processing.sharpening:
        blurred = cv2.GaussianBlur(image, (0, 0), processing.sharpening_px)
        image = cv2.addWeighted(image, 1 + processing.sharpening, blurred, -processing.sharpening, 0)
    if processing.first_quality:
        image = decode_image(encode_photograph(image, processing.first_quality), "the earlier file")
    if is_small:
        image = cv2.resize(image, (width, height), interpolation=INTERPOLATIONS[processing.enlarged_by])
    if processing.grain or processing.scratches or processing.dust:
        image = _aged(processing, image, rng)
    if processing.moire:
        image = _photographed_screen(image, processing.moire, rng)
    if processing.colours < 256:
        image = _posterised(image, processing.colours)
    return _with_text(processing, image) if processing.text else image


def _interlaced(image: UInt8[ndarray, "h w 3"], share: float) -> UInt8[ndarray, "h w 3"]:
    """Shifts odd and even lines to opposite sides by the same amount, so that edges agree with the maps on average."""
    half = int(np.copysign(max(round(abs(share) * image.shape[1] / 2), 1), share))
    columns = np.arange(image.shape[1])
    moved = np.empty_like(image)
    for first, shift in ((0, -half), (1, half)):
        moved[first::2] = image[first::2, np.clip(columns - shift, 0, len(columns) - 1)]
    return moved


def _aged(processing: Processing, image: UInt8[ndarray, "h w 3"], rng: np.random.Generator) -> UInt8[ndarray, "h w 3"]:
    """Adds grain, scratches and dust, all of them grey."""
    height, width = image.shape[:2]
    marks = np.zeros((height, width), dtype=np.float32)
    if processing.grain:
        marks += cv2.GaussianBlur(noise_window(rng, height, width), (0, 0), 0.7) * np.float32(2.5 * processing.grain)
    for _ in range(processing.scratches):
        top, bottom = np.sort(rng.uniform(-0.3, 1.3, 2)) * height
        x, slant = rng.uniform(0, width), rng.normal(0, 0.01) * height
        ends = ((round(x), round(top)), (round(x + slant), round(bottom)))
        cv2.line(marks, ends[0], ends[1], float(rng.uniform(-90, 140)), 1, cv2.LINE_AA)
    for _ in range(processing.dust):
        x, y, length = rng.uniform(0, width), rng.uniform(0, height), rng.exponential(0.012) * width
        axes = (max(round(length), 1), max(round(rng.uniform(0.2, 1.0) * min(length, 3)), 1))
        bend = float(rng.uniform(20, 360))
        colour = float(rng.uniform(-110, 150))
        cv2.ellipse(marks, (round(x), round(y)), axes, float(rng.uniform(0, 360)), 0, bend, colour, 1, cv2.LINE_AA)
    return cv2.add(image, cv2.merge([marks] * 3), dtype=cv2.CV_8U)


def _photographed_screen(
    image: UInt8[ndarray, "h w 3"], strength: float, rng: np.random.Generator
) -> UInt8[ndarray, "h w 3"]:
    """Adds the moiré of the grids of screen and sensor, shifted by a third of a period between colours."""
    height, width = image.shape[:2]
    angle, period = rng.uniform(0, np.pi), rng.uniform(2.5, 14)
    across = np.arange(width, dtype=np.float32) * np.float32(2 * np.pi * np.cos(angle) / period)
    down = np.arange(height, dtype=np.float32) * np.float32(2 * np.pi * np.sin(angle) / period)
    bend = np.float32(rng.uniform(0, 3)) * np.sin(np.arange(height, dtype=np.float32) * np.float32(3.0 / height))
    phase = across + (down + bend)[:, None]
    thirds = np.float32(2 * np.pi / 3) * np.arange(3, dtype=np.float32)
    pattern: Float32[ndarray, "h w 3"] = 1 + np.float32(strength) * np.sin(phase[..., None] + thirds)
    return np.clip(image * pattern, 0, 255).astype(np.uint8)


def _posterised(image: UInt8[ndarray, "h w 3"], colours: int) -> UInt8[ndarray, "h w 3"]:
    steps = np.rint(np.arange(256) * ((colours - 1) / 255)) * (255 / (colours - 1))
    return cv2.LUT(image, np.asarray(np.rint(steps), dtype=np.uint8))


def _with_text(processing: Processing, image: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 3"]:
    height, width = image.shape[:2]
    letters = np.zeros((height, width), dtype=np.uint8)
    scale = max(processing.text_size * max(height, width) / 22, 0.2)  # letters of this font are 22 pixels high
    place = (round(processing.text_place[0] * width), round(processing.text_place[1] * height))
    thickness = max(round(1.5 * scale), 1)
    cv2.putText(letters, processing.text, place, cv2.FONT_HERSHEY_SIMPLEX, scale, 255, thickness, cv2.LINE_AA)
    opacity = letters[..., None] * np.float32(processing.text_opacity / 255)
    colour = np.array((255, 170, 60) if processing.text[0].isdigit() else (255, 255, 255), dtype=np.float32)
    return np.clip(image * (1 - opacity) + colour * opacity + 0.5, 0, 255).astype(np.uint8)
