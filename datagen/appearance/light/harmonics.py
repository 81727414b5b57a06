"""Light from all directions as spherical harmonics of order 2: nine polynomials of the direction for each colour.

    L(d) = sum over i of c_i P_i(d),   P = 1, x, y, z, xy, yz, 3 z^2 - 1, xz, x^2 - y^2

The polynomials are orthogonal on the sphere, but not normalised, which keeps the shader simple.

Source: Ramamoorthi and Hanrahan 2001, An Efficient Representation for Irradiance Environment Maps.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

N_HARMONICS = 9
# 1 / (integral of P_i^2 over the sphere).
_NORMS = np.array([1, 3, 3, 3, 15, 15, 5 / 4, 15, 15 / 4]) / (4 * np.pi)
# Factors of the bands for the convolution with the clamped cosine, divided by pi: the radiance of a white surface.
COSINE_BANDS = np.repeat([1.0, 2 / 3, 1 / 4], [1, 3, 5])


def harmonics_at(directions: Float[ndarray, "n 3"]) -> Float64[ndarray, "n 9"]:
    """Evaluates the nine polynomials at unit vectors."""
    x, y, z = np.asarray(directions, dtype=np.float64).T
    return np.stack([np.ones_like(x), x, y, z, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y], axis=1)


def project_radiance(
    directions: Float[ndarray, "n 3"], radiance: Float[ndarray, "n 3"], solid_angles: Float[ndarray, " n"]
) -> Float64[ndarray, "9 3"]:
    """Projects radiance, given on a partition of the sphere into solid angles (steradians), to coefficients."""
    return np.asarray(_NORMS[:, None] * (harmonics_at(directions).T @ (radiance * solid_angles[:, None])))


def point_light(direction: Float[ndarray, "3"], colour: Float[ndarray, "3"]) -> Float64[ndarray, "9 3"]:
    """Returns the coefficients of a distant lamp in a direction of unit length; the colour is irradiance / pi."""
    return np.asarray((_NORMS * harmonics_at(direction[None])[0])[:, None] * (np.pi * np.asarray(colour))[None])


def white_surface(harmonics: Float[ndarray, "9 3"], normals: Float[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
    """Returns the radiance of white diffuse surfaces with these normals: irradiance / pi, clipped at 0."""
    return np.asarray(np.maximum(harmonics_at(normals) @ (COSINE_BANDS[:, None] * harmonics), 0))


def turned(harmonics: Float[ndarray, "9 3"], rotation: Float[ndarray, "3 3"]) -> Float64[ndarray, "9 3"]:
    """Rotates light: L'(rotation d) = L(d)."""
    directions, inverse = _probes()
    return np.asarray(inverse @ harmonics_at(directions @ rotation) @ harmonics)


@lru_cache(maxsize=1)
def _probes() -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, "9 n"]]:
    """Returns directions, and the matrix that maps values at them to coefficients."""
    directions = fibonacci_sphere(24)
    return directions, np.linalg.pinv(harmonics_at(directions))


def fibonacci_sphere(n: int) -> Float64[ndarray, "n 3"]:
    """Returns evenly distributed unit vectors."""
    z = 1 - (2 * np.arange(n) + 1) / n
    angle = np.arange(n) * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
