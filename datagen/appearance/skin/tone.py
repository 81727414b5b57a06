"""Computes the colour of skin from melanin in the epidermis and haemoglobin in the dermis.

Light passes through the epidermis, is reflected by the dermis, and passes through the epidermis again. Melanin absorbs
light on both passes, and haemoglobin absorbs light in the dermis. The surface reflects some light independently:

    albedo = surface + dermis exp(-m melanin - h haemoglobin)        (each a colour, linear sRGB)

The absorption of melanin is proportional to the wavelength to the power of -3.3 (with 610, 545 and 465 nm for red,
green and blue). That of haemoglobin is the one of oxygenated blood. Both are reduced to account for broad primaries.
The colours range from albinism to the darkest skin, and from pallor to sunburn.

Source: Anderson and Parrish 1981, The Optics of Human Skin.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

SURFACE = np.array([0.008, 0.0155, 0.0150])
DERMIS = np.array([0.778, 0.645, 0.510])
MELANIN = np.array([2.85, 3.95, 5.60])
HAEMOGLOBIN = np.array([0.10, 0.90, 0.65])
USUAL_HAEMOGLOBIN = 0.16  # of skin at rest
DENSITIES = (0.012, 0.95)  # density of melanin in the lightest and the darkest skin

_XYZ_FROM_SRGB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
_WHITE = np.array([0.9505, 1.0, 1.089])


def albedo_of_skin(
    melanin: float | Float64[ndarray, " *n"], haemoglobin: float | Float64[ndarray, " *n"]
) -> Float64[ndarray, "*n 3"]:
    """Returns the linear sRGB albedo of skin.

    Args:
        melanin: Density of melanin, as returned by `density_of_melanin`; 0 is none.
        haemoglobin: Density of haemoglobin: 0 is none, 0.16 usual, 0.5 flushed.
    """
    absorbed = np.asarray(melanin)[..., None] * MELANIN + np.asarray(haemoglobin)[..., None] * HAEMOGLOBIN
    return np.asarray(SURFACE + DERMIS * np.exp(-absorbed))


def density_of_melanin(melanin: float) -> float:
    """Returns the density of melanin for a value from 0 (lightest skin) to 1 (darkest), linear in lightness."""
    densities, lightness = _lightness_by_density()
    wanted = lightness[0] + min(max(melanin, 0), 1) * (lightness[-1] - lightness[0])
    return float(np.interp(-wanted, -lightness, densities))


@lru_cache(maxsize=1)
def _lightness_by_density() -> tuple[Float64[ndarray, " n"], Float64[ndarray, " n"]]:
    densities = np.linspace(*DENSITIES, 101)
    return densities, lab_of_linear(albedo_of_skin(densities, np.full(101, USUAL_HAEMOGLOBIN)))[:, 0]


def lab_of_linear(colour: Float[ndarray, "*n 3"]) -> Float64[ndarray, "*n 3"]:
    """Converts linear sRGB to CIE L*a*b* (D65)."""
    ratio = np.asarray(colour, dtype=np.float64) @ _XYZ_FROM_SRGB.T / _WHITE
    cube = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16 / 116)
    x, y, z = (cube[..., axis] for axis in range(3))
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)
