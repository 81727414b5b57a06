"""Lays pictures over one another: NumPy takes ten times as long along the short axis of colours."""

from jaxtyping import Float32
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled


@compiled
def lay_over(
    below: Float32[ndarray, "h w 3"],
    radiance: Float32[ndarray, "h w 3"],
    coverage: Float32[ndarray, "h w"],
    white: Float32[ndarray, "3"],
) -> None:
    """Lays a picture over another one, in place.

    Args:
        below: What is behind, linear; changed.
        radiance: What is in front, linear, times its coverage.
        coverage: How much of each pixel it covers, 0 to 1.
        white: The colour of its light.
    """
    for row in range(below.shape[0]):
        for column in range(below.shape[1]):
            past = 1 - coverage[row, column]
            for k in range(3):
                below[row, column, k] = below[row, column, k] * past + radiance[row, column, k] * white[k]
