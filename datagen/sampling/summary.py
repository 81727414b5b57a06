"""How often distances and expressions occur in a table that `datagen sample` drew."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from datagen.sampling.expressions import strengths_of, without_side
from pix2face.face_files.coefficients import FaceCoefficients

_YAW_EDGES_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, np.inf)
_DISTANCE_EDGES_MM = (0.0, 400.0, 600.0, 1000.0, 1600.0, 2500.0, 4500.0, np.inf)
# A shape counts as active from here on.
_ACTIVE = 0.1


def drawn_shares(table: FaceCoefficients, yaw_deg: Float64[ndarray, " n"]) -> dict[str, dict[str, float]]:
    """Shares of the faces of a table, as far as their attributes say what was drawn.

    Args:
        table: A table of `datagen sample`; only the yaw of other tables is counted.
        yaw_deg: The yaw of some of its faces.
    """
    shares = {"|yaw|": _binned(np.abs(yaw_deg), _YAW_EDGES_DEG, "°")}
    attributes: list[dict[str, Any]] = [json.loads(text) for text in table.attributes]
    distances = [one["distance_mm"] for one in attributes if "distance_mm" in one]
    if distances:
        shares["distance"] = _binned(np.array(distances, dtype=np.float64), _DISTANCE_EDGES_MM, " mm")
    kinds = Counter(str(one["expression"]).partition("/")[0] for one in attributes if "expression" in one)
    if kinds:
        shares["expression"] = _ranked(kinds, len(attributes))
        # A shape of both sides counts once.
        active = Counter(name for one in attributes for name in _active_shapes(one))
        shares[f"active (from {_ACTIVE})"] = _ranked(active, len(attributes))
    return shares


def _active_shapes(attributes: Mapping[str, Any]) -> set[str]:
    return {without_side(name) for name, value in strengths_of(attributes).items() if value >= _ACTIVE}


def _ranked(counts: Mapping[str, int], n: int) -> dict[str, float]:
    return {name: count / n for name, count in sorted(counts.items(), key=lambda entry: (-entry[1], entry[0]))}


def _binned(values: Float64[ndarray, " n"], edges: Sequence[float], unit: str) -> dict[str, float]:
    return {
        f"{low:.0f}..{high:.0f}{unit}" if np.isfinite(high) else f"from {low:.0f}{unit}": float(
            ((values >= low) & (values < high)).mean()
        )
        for low, high in pairwise(edges)
    }
