"""Crops that reach beyond the border of their photograph, and pictures in a frame.

Pixels beyond the border are filled in common ways. Maps are amodal and continue there, but the face is not visible in
these pixels, which `beyond_border` returns.
"""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, UInt8
from numpy import ndarray

from datagen.random_streams import rounded

# Fillings of the pixels beyond the border. `blurred` is the picture itself, enlarged and blurred.
FILLINGS = ("black", "replicated", "reflected", "white", "mean", "blurred")


@final
@dataclass(frozen=True, kw_only=True)
class Border:
    """The border of the photograph in the picture."""

    left: float = 0.0  # share of the picture's width beyond the border
    top: float = 0.0  # share of its height
    right: float = 0.0
    bottom: float = 0.0
    filling: str = "black"  # one of `FILLINGS`

    @property
    def is_there(self) -> bool:
        """Whether a part of the picture is beyond the border."""
        return max(self.left, self.top, self.right, self.bottom) > 0


def beyond_border(border: Border, height: int, width: int) -> Bool[ndarray, "h w"]:
    """Returns a mask of the pixels of a picture that are beyond the photograph's border."""
    beyond = np.ones((height, width), dtype=bool)
    beyond[_inside(border, height, width)] = False
    return beyond


def with_border(border: Border, image: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 3"]:
    """Fills the pixels of a picture that are beyond the border."""
    if not border.is_there:
        return image
    height, width = image.shape[:2]
    rows, columns = _inside(border, height, width)
    inside = np.ascontiguousarray(image[rows, columns])
    margins = (rows.start, height - rows.stop, columns.start, width - columns.stop)
    if border.filling == "replicated":
        return cv2.copyMakeBorder(inside, *margins, cv2.BORDER_REPLICATE)
    if border.filling == "reflected":
        return cv2.copyMakeBorder(inside, *margins, cv2.BORDER_REFLECT)
    if border.filling == "blurred":
        filled = cv2.resize(inside, (width, height), interpolation=cv2.INTER_LINEAR)
        filled = cv2.blur(filled, (max(width // 8, 1), max(height // 8, 1)))
        filled[rows, columns] = inside
        return filled
    value = {"white": (255.0, 255.0, 255.0), "mean": cv2.mean(inside)[:3]}.get(border.filling, (0.0, 0.0, 0.0))
    return cv2.copyMakeBorder(inside, *margins, cv2.BORDER_CONSTANT, value=[round(channel) for channel in value])


def draw_border(rng: np.random.Generator, largest: float) -> Border:
    """Draws a border on one, two or four sides, most often on one."""
    n_sides = int(rng.choice([1, 2, 4], p=[0.62, 0.30, 0.08]))
    sides = np.zeros(4)
    chosen = rng.choice(4, n_sides, replace=False)
    # Four borders make a small picture in a large frame.
    sides[chosen] = rng.uniform(0.02, largest * (0.5 if n_sides == 4 else 1.0), n_sides)
    filling = str(rng.choice(FILLINGS, p=[0.5, 0.18, 0.12, 0.10, 0.07, 0.03]))
    if filling == "reflected":
        sides *= 0.4  # so that no half of a second face appears
    left, top, right, bottom = (rounded(share, 4) for share in sides)
    return Border(left=left, top=top, right=right, bottom=bottom, filling=filling)


def draw_letterbox(rng: np.random.Generator) -> Border:
    """Draws bars of about the same width on two opposite sides."""
    width = rng.uniform(0.04, 0.25)
    first, second = (rounded(width + rng.uniform(0, 0.05), 4) for _ in range(2))
    filling = str(rng.choice(["black", "white", "blurred"], p=[0.7, 0.1, 0.2]))
    if rng.random() < 0.6:
        return Border(top=first, bottom=second, filling=filling)
    return Border(left=first, right=second, filling=filling)


def _inside(border: Border, height: int, width: int) -> tuple[slice, slice]:
    """Returns the rows and columns of the photograph, at least one pixel."""
    top, bottom = (int(share * height + 0.5) for share in (border.top, border.bottom))
    left, right = (int(share * width + 0.5) for share in (border.left, border.right))
    top, left = min(top, height - 1), min(left, width - 1)
    return slice(top, max(height - bottom, top + 1)), slice(left, max(width - right, left + 1))
