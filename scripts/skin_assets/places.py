"""Computes the place on the mean face of each texel of a texture."""

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.interpolate import LinearNDInterpolator

from pix2face.models.morphable_model import MorphableModel

NOWHERE = -1000.0


def places(
    model: MorphableModel,
    regions: tuple[str, ...],
    uv_box: tuple[float, float, float, float],
    size_px: tuple[int, int],
) -> Float64[ndarray, "h w 3"]:
    """Returns places in mm, rows from the top (largest v); ``NOWHERE`` outside the regions.

    Args:
        model: Model with texture coordinates.
        regions: Regions of the texture, whose texture coordinates must not overlap.
        uv_box: Range of texture coordinates that the texture shows: smallest and largest u, then v.
        size_px: Height and width of the texture.
    """
    assert model.uv is not None
    assert model.uv_triangles is not None
    wanted = model.triangles_of(*regions)
    uv_index, first = np.unique(model.uv_triangles[wanted], return_index=True)
    vertex = model.triangles[wanted].reshape(-1)[first]
    u = uv_box[0] + (np.arange(size_px[1]) + 0.5) / size_px[1] * (uv_box[1] - uv_box[0])
    v = uv_box[3] - (np.arange(size_px[0]) + 0.5) / size_px[0] * (uv_box[3] - uv_box[2])
    place = LinearNDInterpolator(model.uv[uv_index], model.mean[vertex].astype(np.float64), fill_value=NOWHERE)
    return np.asarray(place(*np.meshgrid(u, v)))
