"""Light and how pictures store it."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray


def srgb_to_linear(values: Float[ndarray, "*n"]) -> Float[ndarray, "*n"]:
    """Light that is proportional to values as pictures hold them, both 0..1. Source: IEC 61966-2-1."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: Float[ndarray, "*n"]) -> Float[ndarray, "*n"]:
    """The inverse of ``srgb_to_linear``."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)
