"""Heads that accessories are tried on."""

from functools import lru_cache

import numpy as np
from numpy import ndarray
from scipy.spatial import cKDTree

from datagen.appearance.scene import PosedHead, Surface
from pix2face.models.morphable_model import builtin_model


def random_head(seed: int, expression_strength: float = 0.5) -> PosedHead:
    """A random identity and expression; the mean without expression for seed 0."""
    model, rng = builtin_model(), np.random.default_rng(seed)
    identity = rng.normal(size=(1, model.n_identity)) * (seed > 0)
    expression = expression_strength * rng.normal(size=(1, model.n_expression)) * (seed > 0)
    vertices = model.vertices(identity, expression)[0]
    neutral = model.vertices(identity, 0 * expression)[0]
    return PosedHead(model=model, vertices=vertices, normals=_surface().normals(vertices), neutral=neutral)


@lru_cache(maxsize=1)
def _surface() -> Surface:
    return Surface(builtin_model())


def outside_mm(points: ndarray, head: PosedHead, regions: tuple[str, ...]) -> ndarray:
    """Distance of points from the surface of some regions, negative inside: by the plane of the nearest vertex."""
    chosen = head.model.vertices_of(*regions)
    nearest = chosen[cKDTree(head.vertices[chosen]).query(points)[1]]
    return np.einsum("ij,ij->i", points - head.vertices[nearest], head.normals[nearest])
