"""The layers of a sample: what each holds, in which unit, and how it is stored.

A layer has one entry here; renderer, shards, commands and pages go by this table.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from jaxtyping import Shaped
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM


@final
@dataclass(frozen=True, kw_only=True)
class Layer:
    """One value, or some, for each pixel."""

    name: str  # also of its dataset in a shard, and of its choice on a command line
    n_channels: int  # arrays are (h, w, n_channels), or (h, w) where it is 1
    unit: str = ""
    dtype: Any  # in memory
    stored: Any  # dtype of the values in steps, as files hold them
    steps_per_unit: int = 1  # rounding is at most half a step off
    is_smooth: bool = False  # neighbours differ little, so that files hold what a predictor leaves (`map_storage`)
    meaning: str

    def shape(self, height_px: int, width_px: int) -> tuple[int, ...]:
        """Returns the shape of the layer's array for a picture of this size."""
        return (height_px, width_px) if self.n_channels == 1 else (height_px, width_px, self.n_channels)

    @property
    def limit(self) -> float:
        """Largest magnitude that can be stored, in the unit of the layer."""
        return math.floor(10 * np.iinfo(self.stored).max / self.steps_per_unit) / 10


_TABLE = (
    Layer(
        name="pncc",
        n_channels=3,
        unit="mm",
        dtype=np.float32,
        stored=np.dtype("<i2"),
        steps_per_unit=FIXED_POINT_STEPS_PER_MM,
        is_smooth=True,
        meaning="the matching point on the mean face, model frame; 0 outside the mask",
    ),
    Layer(
        name="offset",
        n_channels=3,
        unit="mm",
        dtype=np.float32,
        stored=np.dtype("<i2"),
        steps_per_unit=FIXED_POINT_STEPS_PER_MM,
        is_smooth=True,
        meaning="the vector from that point to the same point on this face, model frame; 0 outside the mask",
    ),
    Layer(
        name="mask",
        n_channels=1,
        dtype=np.bool_,
        stored=np.dtype("u1"),
        meaning="where PNCC and offset are valid: the nearest triangle belongs to the face and shows its outside",
    ),
    Layer(
        name="depth",
        n_channels=1,
        unit="mm",
        dtype=np.float32,
        stored=np.dtype("<i4"),
        steps_per_unit=128,
        is_smooth=True,
        meaning="z in the camera frame, larger is farther; 0 outside the mask",
    ),
    Layer(
        name="normals",
        n_channels=3,
        dtype=np.float32,
        stored=np.dtype("<i2"),
        steps_per_unit=4096,
        is_smooth=True,
        meaning="unit normals of the surface, camera frame (x right, y down, z forward); 0 outside the mask",
    ),
    Layer(
        name="uv",
        n_channels=2,
        dtype=np.float32,
        stored=np.dtype("<i2"),
        steps_per_unit=16384,
        is_smooth=True,
        meaning="texture coordinates of the model; 0 outside the mask",
    ),
    Layer(
        name="regions",
        n_channels=1,
        dtype=np.uint8,
        stored=np.dtype("u1"),
        meaning="0 for the background, otherwise 1 + index into region_names of the header; on the whole head",
    ),
    Layer(
        name="seen",
        n_channels=1,
        dtype=np.bool_,
        stored=np.dtype("u1"),
        meaning="the part of the mask that is visible in the picture: not behind hair, glasses, hands or hats, and not "
        "beyond the border of the photograph",
    ),
    Layer(
        name="coverage",
        n_channels=1,
        dtype=np.float32,
        stored=np.dtype("u1"),
        steps_per_unit=255,
        meaning="share of the pixel, 0 to 1, that shows the person (with hair, clothes and held things) or an object "
        "in front; the rest of the pixel shows the backdrop",
    ),
    Layer(
        name="seen_regions",
        n_channels=1,
        dtype=np.uint8,
        stored=np.dtype("u1"),
        meaning="as regions, for what is nearest in the picture: the regions of the head, and after these hair, "
        "glasses, clothes and other objects",
    ),
)
LAYERS: Mapping[str, Layer] = {layer.name: layer for layer in _TABLE}
# What a sample can have beside maps: not one value for each pixel, but chosen in the same way.
IMAGE, LANDMARKS = "image", "landmarks"
LAYER_NAMES = (IMAGE, *LAYERS, LANDMARKS)
DEFAULT_LAYERS = (IMAGE, "pncc", "offset", "mask", LANDMARKS)
ALL_LAYERS = "all"  # instead of a list of names
# Layers that hold beyond the mask.
WHOLE_PICTURE_LAYERS = ("regions", "coverage", "seen_regions")
# Layers that are known of pictures that were drawn, not of photographs: what stands before the face, and before the
# backdrop.
SEEN, COVERAGE, SEEN_REGIONS = "seen", "coverage", "seen_regions"
SCENE_LAYERS = (SEEN, COVERAGE, SEEN_REGIONS)


def parse_layers(text: str) -> tuple[str, ...]:
    """Reads a choice such as ``image,pncc,offset,mask``, or ``all``; see ``order_layers``."""
    if text.strip() == ALL_LAYERS:
        return LAYER_NAMES
    return order_layers([name.strip() for name in text.split(",") if name.strip()])


def order_layers(names: Sequence[str]) -> tuple[str, ...]:
    """The names, each once, in the order of ``LAYER_NAMES``.

    Raises:
        UsageError: A name is unknown, or there is none.
    """
    unknown = [name for name in names if name not in LAYER_NAMES]
    if unknown or not names:
        found = repr(unknown[0]) if unknown else "none"
        raise UsageError(f"expected layers among {','.join(LAYER_NAMES)}, or {ALL_LAYERS}, found {found}")
    return tuple(name for name in LAYER_NAMES if name in names)


def to_stored(layer: Layer, values: Shaped[ndarray, "*shape"]) -> Shaped[ndarray, "*shape"]:
    """Values in their unit to steps; values in steps already (the layer's stored dtype) stay as they are.

    Raises:
        InputFileError: A value is not finite or beyond what can be stored.
    """
    if values.dtype == layer.stored:
        return np.ascontiguousarray(values)
    if layer.steps_per_unit == 1:
        return np.ascontiguousarray(values, dtype=layer.stored)
    largest = float(max(values.max(initial=0), -values.min(initial=0)))
    if not largest <= layer.limit:  # also catches NaN
        raise InputFileError(
            f"expected {layer.name} within ±{layer.limit:g} {layer.unit}".rstrip()
            + f", found {largest:.6g}; are model and coefficients sound, in mm, with the origin inside the head?"
        )
    steps = values * np.float32(layer.steps_per_unit)
    return np.rint(steps, out=steps).astype(layer.stored)


def from_stored(layer: Layer, steps: Shaped[ndarray, "*shape"]) -> Shaped[ndarray, "*shape"]:
    """Steps, as a file holds them, to values in the unit of the layer."""
    if layer.steps_per_unit == 1:
        return steps.astype(layer.dtype)
    return np.multiply(steps, np.float32(1 / layer.steps_per_unit), dtype=np.float32)
