"""The small head with texture coordinates: seen from the front, the back shifted aside, so that there is a seam."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from pix2face.models.morphable_model import MorphableModel
from tests.synthetic_models import small_head_model


@lru_cache(maxsize=1)
def textured_head() -> MorphableModel:
    """The small head; its front half has u from 0.02 to 0.48, its back half from 0.52 to 0.98."""
    model = small_head_model()
    n_vertices = len(model.mean)
    places = (model.mean[:, :2] - model.mean[:, :2].min(axis=0)) / np.ptp(model.mean[:, :2], axis=0)
    front = places * [0.46, 0.96] + [0.02, 0.02]
    back = front + [0.5, 0.0]
    is_back = model.mean[model.triangles].mean(axis=1)[:, 2] < 0
    uv_triangles = model.triangles + n_vertices * is_back[:, None].astype(np.int32)
    return replace(
        model,
        name="small textured head",
        uv=np.concatenate([front, back]).astype(np.float32),
        uv_triangles=uv_triangles.astype(np.int32),
    )
