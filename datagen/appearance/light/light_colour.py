"""Colours of light: black bodies, saturation, white balance. Linear sRGB."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_SRGB_FROM_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
_C2_NM_K = 1.4388e7  # h c / k
# The CIE colour matching functions as sums of lobes: amplitude, centre, and width to either side (nm).
# Source: Wyman, Sloan and Shirley 2013, Simple Analytic Approximations to the CIE XYZ Color Matching Functions.
_LOBES = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)


@lru_cache(maxsize=1)
def _curves() -> tuple[Float64[ndarray, " n"], Float64[ndarray, "3 n"]]:
    wavelengths = np.arange(380.0, 781.0, 5.0)
    curves = [
        sum(
            amplitude * np.exp(-0.5 * ((wavelengths - centre) / np.where(wavelengths < centre, below, above)) ** 2)
            for amplitude, centre, below, above in lobes
        )
        for lobes in _LOBES
    ]
    return wavelengths, np.stack([np.asarray(curve) for curve in curves])


def black_body(temperature_k: float) -> Float64[ndarray, "3"]:
    """Returns the colour of a black body with luminance 1; 6500 K is about white. Colours outside sRGB are clipped.

    Source: Planck's law.
    """
    wavelengths, curves = _curves()
    spectrum = wavelengths**-5.0 / np.expm1(_C2_NM_K / (wavelengths * temperature_k))
    rgb = np.maximum(_SRGB_FROM_XYZ @ curves @ spectrum, 0)
    return np.asarray(rgb / (LUMINANCE @ rgb))


def lamp_colour(temperature_k: float, camera_k: float) -> Float64[ndarray, "3"]:
    """Returns the colour of a lamp with luminance 1, as seen by a camera with a white balance for `camera_k`."""
    rgb = black_body(temperature_k) / np.maximum(black_body(camera_k), 0.02)
    return np.asarray(rgb / (LUMINANCE @ rgb))


def saturation_matrix(saturation: float) -> Float64[ndarray, "3 3"]:
    """Returns the matrix that scales the saturation of linear colours (columns) and keeps their luminance."""
    return np.asarray(saturation * np.eye(3) + (1 - saturation) * np.outer(np.ones(3), LUMINANCE))


def balance_matrix(mean_colour: Float[ndarray, "3"], strength: float) -> Float64[ndarray, "3 3"]:
    """Returns the white balance that makes a mean colour grey (strength 1) or partly grey, and keeps its luminance.

    Gains are limited to a factor of 3, since no camera corrects monochromatic light completely.
    """
    mean = np.maximum(np.asarray(mean_colour, dtype=np.float64), 1e-9)
    gains = np.clip((LUMINANCE @ mean / mean) ** strength, 1 / 3, 3)
    return np.asarray(np.diag(gains * (LUMINANCE @ mean) / (LUMINANCE @ (gains * mean))))
