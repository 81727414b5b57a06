"""Normal noise for pictures, cut out of one field: drawing it anew would take longer than all else about a picture."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

# A prime, so that windows which are larger than the field repeat in no common rhythm.
_SIDE = 1009


def noise_window(rng: np.random.Generator, height: int, width: int) -> Float32[ndarray, "h w"]:
    """Independent standard normal values: a window of a fixed field, at a place of its own, to be read only."""
    top, left = (int(place) for place in rng.integers(0, _SIDE, 2))
    field = _field()
    if top + height <= _SIDE and left + width <= _SIDE:
        return field[top : top + height, left : left + width]
    rows, columns = np.arange(top, top + height) % _SIDE, np.arange(left, left + width) % _SIDE
    return field[rows[:, None], columns]


@lru_cache(maxsize=1)
def _field() -> Float32[ndarray, "s s"]:
    field = np.random.default_rng(20).standard_normal((_SIDE, _SIDE), dtype=np.float32)
    field.flags.writeable = False
    return field
