"""The smooth outside of a head that hats and scarves lie on, as distances from a middle."""

from dataclasses import dataclass
from functools import lru_cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray

from datagen.appearance.accessories.head_fit import Anchors, anchors_outward
from datagen.appearance.scene import PosedHead
from pix2face.models.morphable_model import MorphableModel

CENTRE = np.array([0.0, 40.0, 0.0])
_ROWS, _COLUMNS = 31, 49
_LOWEST_DEG = -75.0


def direction(rise: Float[ndarray, "*#n"], around: Float[ndarray, "*#n"]) -> Float[ndarray, "*_ 3"]:
    """Unit vectors.

    Args:
        rise: Radians above the horizon.
        around: Radians: 0 the front, positive towards the subject's left.
    """
    rise, around = np.broadcast_arrays(rise, around)
    level = np.cos(rise)
    return np.stack([level * np.sin(around), np.sin(rise), level * np.cos(around)], axis=-1)


@final
@dataclass(frozen=True, eq=False)
class Skull:
    """The outside of one head.

    Attributes:
        centre: Middle of the skull, mm, model frame.
        radii: Distance of the skin, mm; rows from the crown down, columns around from the back over the right side.
    """

    centre: Float32[ndarray, "3"]
    radii: Float32[ndarray, "r c"]

    def radius(self, rise: Float[ndarray, "*#n"], around: Float[ndarray, "*#n"]) -> Float32[ndarray, "*_"]:
        """Distance of the skin from the centre, mm; arguments as ``direction``."""
        top, low = np.pi / 2, np.deg2rad(_LOWEST_DEG)
        rows = np.clip((top - rise) / (top - low), 0, 1) * (_ROWS - 1)
        columns = np.mod(around / (2 * np.pi) + 0.5, 1.0) * (_COLUMNS - 1)
        rows, columns = np.broadcast_arrays(rows, columns)
        row = np.minimum(rows.astype(np.intp), _ROWS - 2)
        column = np.minimum(columns.astype(np.intp), _COLUMNS - 2)
        down, along = rows - row, columns - column
        upper = (1 - along) * self.radii[row, column] + along * self.radii[row, column + 1]
        lower = (1 - along) * self.radii[row + 1, column] + along * self.radii[row + 1, column + 1]
        return np.asarray((1 - down) * upper + down * lower, dtype=np.float32)

    def at(
        self, rise: Float[ndarray, "*#n"], around: Float[ndarray, "*#n"], above_mm: Float[ndarray, "*#n"] | float
    ) -> Float32[ndarray, "*_ 3"]:
        """Points so far above the skin, mm, model frame."""
        rise, around, above_mm = np.broadcast_arrays(rise, around, above_mm)
        distance = self.radius(rise, around) + above_mm
        return np.asarray(self.centre + distance[..., None] * direction(rise, around), dtype=np.float32)


def fit_skull(head: PosedHead, *, with_expression: bool = False) -> Skull:
    """Measures a head; hats are rigid and want it without its expression, scarves with it."""
    place = head.vertices if with_expression else head.neutral
    points = _anchors(head.model).at(place)
    centre = CENTRE + (points - _anchors(head.model).at(head.model.mean))[: _COLUMNS * 15].mean(axis=0)
    ways = direction(*_grid()).reshape(-1, 3)
    radii = ((points - centre) * ways).sum(axis=1).reshape(_ROWS, _COLUMNS).astype(np.float32)
    wrapped = np.concatenate([radii[:, -4:-1], radii, radii[:, 1:4]], axis=1)
    smooth = cv2.GaussianBlur(wrapped, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE)
    return Skull(centre.astype(np.float32), np.maximum(smooth, 0.5 * (smooth + wrapped))[:, 3:-3])


def _grid() -> tuple[Float[ndarray, "r c"], Float[ndarray, "r c"]]:
    rise = np.linspace(np.pi / 2, np.deg2rad(_LOWEST_DEG), _ROWS)
    return np.meshgrid(rise, np.linspace(-np.pi, np.pi, _COLUMNS), indexing="ij")


@lru_cache(maxsize=4)
def _anchors(model: MorphableModel) -> Anchors:
    rise, around = _grid()
    return anchors_outward(model, CENTRE, direction(rise, around).reshape(-1, 3))
