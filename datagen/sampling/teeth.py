"""Keeps lower teeth behind lip and chin, by opening the jaw less.

In a linear model, identity and expression are added. A jaw motion that suits the mean head can therefore move the teeth
of another head through its skin. A tooth comes through if it lies in front of the outer surface of lip and chin.
"""

from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32
from numpy import ndarray

from datagen.sampling.expressions import expression_of
from pix2face.models.morphable_model import MorphableModel

# Strength of `jawOpen` at which no tooth of any head comes through (docs/explanation/sampling.md).
HARMLESS_JAW = 0.1
# The strengths of the mouth are multiplied by this factor until no tooth comes through.
_STEP = 0.85
_MOUTH = ("jaw", "mouth", "tongue")
# Smallest and largest distance of a tooth from the surface behind it, mm along z.
_DEPTH_MM = (0.2, 25.0)
_WIDTH_MM = 48.0  # largest distance of the teeth from the middle


@final
class ToothGuard:
    """Finds mixtures in which lower teeth come through the skin of a head.

    It finds none in a model without teeth or lips, or without the named expression `jawOpen`.
    """

    def __init__(self, model: MorphableModel) -> None:
        self._model = model
        self._teeth, self._triangles = _lower_teeth(model), _lip_and_chin(model)
        self._is_needed = bool(len(self._teeth) and len(self._triangles) and "jawOpen" in model.named_expressions)
        self._vertices, places = np.unique(self._triangles, return_inverse=True)
        self._triangles = places.reshape(-1, 3).astype(np.int32)
        known = np.concatenate([self._teeth, self._vertices])
        self._mean = model.mean[known]
        self._identity = model.identity_basis[:, known].reshape(model.n_identity, 3 * len(known))
        self._expression = model.expression_basis[:, known].reshape(model.n_expression, 3 * len(known))

    def tamed(self, identity: Float[ndarray, " k"], strengths: Mapping[str, float]) -> dict[str, float]:
        """Returns the mixture, with a weaker mouth if the teeth of this head would come through."""
        mixture = dict(strengths)
        while mixture.get("jawOpen", 0.0) > HARMLESS_JAW and self.comes_through(identity, mixture):
            for name in mixture:
                if name.startswith(_MOUTH):
                    mixture[name] = round(_STEP * mixture[name], 2)
        return mixture

    def comes_through(self, identity: Float[ndarray, " k"], strengths: Mapping[str, float]) -> bool:
        """Whether a lower tooth lies in front of the outer surface of lip or chin."""
        if not self._is_needed:
            return False
        moved = identity @ self._identity + expression_of(self._model, strengths) @ self._expression
        points = self._mean + moved.reshape(-1, 3).astype(np.float32)
        teeth, corners = points[: len(self._teeth)], points[len(self._teeth) :][self._triangles]
        return bool(_are_before(teeth, corners).any())


def _are_before(points: Float32[ndarray, "p 3"], corners: Float32[ndarray, "t 3 3"]) -> Bool[ndarray, " p"]:
    """Whether each point lies in front of a triangle, within `_DEPTH_MM` along z."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    doubled = _cross(b - a, c - a)
    # Only triangles that face forward and overlap the bounding box of the points.
    low, high = points.min(axis=0), points.max(axis=0)
    nearest, farthest = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    is_met = (nearest <= high).all(axis=1) & (farthest[:, :2] >= low[:2]).all(axis=1)
    a, b, c, doubled = (values[(doubled > 1e-6) & is_met] for values in (a, b, c, doubled))
    to_a, to_b, to_c = (corner[None] - points[:, None] for corner in (a, b, c))
    weights = np.stack([_cross(to_b, to_c), _cross(to_c, to_a), _cross(to_a, to_b)], axis=-1) / doubled[:, None]
    depth = -(weights * np.stack([to_a[..., 2], to_b[..., 2], to_c[..., 2]], axis=-1)).sum(axis=-1)
    return ((weights >= 0).all(axis=-1) & (depth > _DEPTH_MM[0]) & (depth < _DEPTH_MM[1])).any(axis=1)


def _cross(a: Float32[ndarray, "*n 3"], b: Float32[ndarray, "*n 3"]) -> Float32[ndarray, "*n"]:
    """Returns the z coordinate of the cross product."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _lower_teeth(model: MorphableModel) -> Int32[ndarray, " n"]:
    """Returns the vertices at the front of the teeth that the jaw moves."""
    if "teeth" not in model.region_names or "jawOpen" not in model.named_expressions:
        return np.zeros(0, dtype=np.int32)
    triangles = model.triangles[model.triangles_of("teeth")]
    corners = model.mean[triangles]
    forward = triangles[_cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) > 0]
    vertices = np.unique(forward)
    jaw = np.tensordot(model.named_expressions["jawOpen"], model.expression_basis[:, vertices, 1], axes=1)
    return vertices[jaw < 0.5 * jaw.min()].astype(np.int32) if jaw.min() < 0 else np.zeros(0, dtype=np.int32)


def _lip_and_chin(model: MorphableModel) -> Int32[ndarray, "t 3"]:
    """Returns the triangles at the front of lips and skin that the jaw moves by a quarter of its motion or more."""
    triangles = model.triangles[model.triangles_of("lips", "skin")]
    if "jawOpen" not in model.named_expressions or not len(triangles):
        return np.zeros((0, 3), dtype=np.int32)
    jaw = np.tensordot(model.named_expressions["jawOpen"], model.expression_basis[:, :, 1], axes=1)
    is_moved = (jaw[triangles] < 0.25 * jaw.min()).any(axis=1)
    is_in_front = (np.abs(model.mean[triangles][..., 0]) < _WIDTH_MM).all(axis=1)
    is_in_front &= model.mean[triangles][..., 2].min(axis=1) > 0
    return np.asarray(triangles[is_moved & is_in_front], dtype=np.int32)
