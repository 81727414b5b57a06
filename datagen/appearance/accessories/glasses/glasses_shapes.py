"""Outlines of lenses."""

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

SHAPES = ("round", "rectangle", "aviator", "cat-eye", "square", "oval")


def outline(shape: str, count: int) -> Float64[ndarray, "n 2"]:
    """The outline of the left lens in a box from -1 to 1: x away from the nose, y up, from the nose side over the top.

    Args:
        shape: One of ``SHAPES``.
        count: How many points.
    """
    angle = np.pi - np.linspace(0, 2 * np.pi, count, endpoint=False)
    cosine, sine = np.cos(angle), np.sin(angle)
    power = {"round": 2.0, "oval": 2.2, "rectangle": 5.0, "square": 4.0, "cat-eye": 3.0, "aviator": 2.6}[shape]
    radius = (np.abs(cosine) ** power + np.abs(sine) ** power) ** (-1 / power)
    x, y = radius * cosine, radius * sine
    if shape == "cat-eye":
        y = y + 0.28 * np.clip(x, 0, 1) ** 2 * (y > 0)
        x = x * (1 + 0.10 * y)
    if shape == "aviator":
        y = y - 0.12 * x * (y < 0) - 0.10 * (y < 0) * np.cos(1.5 * x)
        x = x * (1 + 0.06 * y) + 0.05 * np.clip(-y, 0, 1)
    if shape in ("rectangle", "square"):
        x = x * (1 + 0.04 * y)
    shaped = np.stack([x, y], axis=1)
    return np.asarray(shaped / np.abs(shaped).max(axis=0))
