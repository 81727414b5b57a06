"""Draws heads of animals with fur, ears, eyes, a muzzle and a nose, which resemble human faces."""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray

from datagen.appearance.backdrop.patterns import PATTERNS

Colour = Float64[ndarray, "3"]


def draw_animals(rng: np.random.Generator, size_px: int, patterns: Sequence[str]) -> UInt8[ndarray, "s s 3"]:
    """Draws one to three animals in front of one of the patterns."""
    picture = PATTERNS[patterns[int(rng.integers(len(patterns)))]](rng, size_px, size_px)
    for _ in range(int(rng.integers(1, 4))):
        _draw_animal(rng, picture)
    return picture


def _draw_animal(rng: np.random.Generator, picture: UInt8[ndarray, "s s 3"]) -> None:
    size_px = len(picture)
    reach = size_px * float(np.exp(rng.uniform(np.log(0.08), np.log(0.45))))  # half the width of the head
    x, y = rng.uniform(0.1, 0.9, 2) * size_px
    turn, squeeze, look = rng.normal(0, 15), rng.uniform(0.8, 1.3), rng.normal(0, 0.18)
    fur = np.array([1.0, rng.uniform(0.6, 1), rng.uniform(0.35, 0.95)]) * rng.uniform(20, 235)
    light = np.clip(fur + rng.uniform(20, 90), 0, 255)

    def place(right: float, down: float) -> tuple[int, int]:
        angle = np.deg2rad(turn)
        return (
            int(x + reach * (np.cos(angle) * right - np.sin(angle) * down)),
            int(y + reach * (np.sin(angle) * right + np.cos(angle) * down)),
        )

    mask = np.zeros((size_px, size_px), dtype=np.uint8)
    coat = np.empty((size_px, size_px, 3), dtype=np.float32)
    coat[...] = fur
    body = (int(reach * rng.uniform(0.9, 1.6)), int(2 * reach))
    cv2.ellipse(mask, place(rng.normal(0, 0.5), 2.2), body, turn, 0, 360, 255, -1)
    cv2.ellipse(mask, place(0, 0), (int(reach), int(reach * squeeze)), turn, 0, 360, 255, -1)
    _draw_ears(rng, mask, coat, place, fur * rng.uniform(0.5, 1.1))
    _ellipse(coat, place(look, 0.45), reach * np.array([rng.uniform(0.3, 0.55), rng.uniform(0.3, 0.6)]), turn, light)
    if rng.uniform() < 0.4:  # a stripe down the forehead
        _ellipse(coat, place(look / 2, -0.4), reach * np.array([0.12, 0.5]), turn, light)
    shaggy = _shaggy(rng, size_px, reach)
    coat *= shaggy[..., None]
    apart, above, eye = rng.uniform(0.3, 0.5), rng.uniform(-0.25, 0.05), rng.uniform(0.07, 0.15)
    for side in (-1, 1):
        middle = place(look + side * apart, above)
        _ellipse(
            coat, middle, reach * eye * np.array([1.15, 1.0]), turn, rng.uniform(10, 130) * np.array([1, 0.8, 0.4])
        )
        _ellipse(coat, middle, reach * eye * np.array([0.6, 0.6]), turn, np.full(3, 8.0))
        glint = (middle[0] - int(reach * eye / 4), middle[1] - int(reach * eye / 3))
        _ellipse(coat, glint, np.full(2, reach * eye * 0.25), turn, np.full(3, 245.0))
    _ellipse(coat, place(look * 1.4, 0.3), reach * np.array([0.17, 0.12]), turn, np.full(3, rng.uniform(5, 70)))
    dark = (fur * 0.3).tolist()
    thick = max(int(reach / 25), 1)
    cv2.line(coat, place(look * 1.4, 0.4), place(look * 1.4, 0.6), dark, thick, cv2.LINE_AA)
    cv2.ellipse(coat, place(look * 1.4, 0.55), (int(reach * 0.25), int(reach * 0.15)), turn, 10, 170, dark, thick)
    if rng.uniform() < 0.3:
        _ellipse(coat, place(look * 1.4, 0.75), reach * np.array([0.12, 0.2]), turn, np.array([215.0, 100, 110]))
    soft = cv2.GaussianBlur(mask, (0, 0), max(reach / 40, 0.5)).astype(np.float32)[..., None] / 255
    picture[...] = np.clip(picture + soft * (coat - picture), 0, 255).astype(np.uint8)


def _draw_ears(
    rng: np.random.Generator,
    mask: UInt8[ndarray, "s s"],
    coat: Float32[ndarray, "s s 3"],
    place: Callable[[float, float], tuple[int, int]],
    colour: Colour,
) -> None:
    """Draws upright or hanging ears."""
    is_hanging, wide = rng.uniform() < 0.5, rng.uniform(0.5, 0.9)
    for side in (-1, 1):
        if is_hanging:
            corners = [
                place(side * 0.7, -0.7),
                place(side * 1.3, -0.4),
                place(side * 1.25, 0.6),
                place(side * 0.9, 0.5),
            ]
        else:
            corners = [place(side * 0.95, -0.3), place(side * wide, -1.6), place(side * 0.2, -0.85)]
        hull = cv2.convexHull(np.array(corners, dtype=np.int32))
        cv2.fillConvexPoly(mask, hull, 255)
        cv2.fillConvexPoly(coat, hull, colour.tolist(), cv2.LINE_AA)


def _ellipse(
    coat: Float32[ndarray, "s s 3"], middle: tuple[int, int], axes: Float64[ndarray, "2"], turn: float, colour: Colour
) -> None:
    half = (max(int(axes[0]), 1), max(int(axes[1]), 1))
    cv2.ellipse(coat, middle, half, turn, 0, 360, colour.tolist(), -1, cv2.LINE_AA)


def _shaggy(rng: np.random.Generator, size_px: int, reach: float) -> Float32[ndarray, "s s"]:
    """Draws strands of fur: noise stretched downward or sideways, with a mean of about 1."""
    noise = rng.standard_normal((size_px, size_px), dtype=np.float32)
    length, thickness = max(reach * rng.uniform(0.05, 0.2), 1), max(reach * rng.uniform(0.004, 0.02), 0.4)
    axes = (length, thickness) if rng.uniform() < 0.3 else (thickness, length)
    strands = np.asarray(cv2.GaussianBlur(noise, (0, 0), sigmaX=axes[0], sigmaY=axes[1]), dtype=np.float32)
    strands /= max(float(strands.std()), 1e-6)
    return np.clip(1 + np.float32(rng.uniform(0.05, 0.35)) * strands, 0.2, 1.8).astype(np.float32)
