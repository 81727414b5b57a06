"""Layers as pictures that people can read."""

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Bool, Shaped, UInt8
from numpy import ndarray

from pix2face.geometry.maps import map_picture
from pix2face.shards.layers import WHOLE_PICTURE_LAYERS

# The ends of the colour scales.
PNCC_LIMIT_MM, OFFSET_LIMIT_MM = 120.0, 15.0
GREY = 128
# What the colours of a layer mean.
LEGENDS = {
    "pncc": f"x, y, z as RGB, ±{PNCC_LIMIT_MM:.0f} mm",
    "offset": f"x, y, z as RGB, ±{OFFSET_LIMIT_MM:.0f} mm",
    "mask": "white: face",
    "depth": "white: nearest, black: farthest",
    "normals": "right, up, near as RGB, ±1",
    "uv": "u, v as red and green, 0 to 1",
    "regions": "one colour for each region",
    "seen": "white: face in sight",
    "seen_regions": "one colour for each region",
    "coverage": "white: person, grey: backdrop",
}


def layer_title(name: str) -> str:
    """The name of a layer in a heading."""
    return name.upper() if name in ("pncc", "uv") else name.replace("_", " ")


def layer_picture(name: str, layers: Mapping[str, ndarray]) -> UInt8[ndarray, "h w 3"]:
    """Draws one of the layers of a sample (in the units of ``pix2face.shards.layers``), grey where it has no value."""
    return _PAINTERS[name](layers[name], layer_mask(name, layers))


def layer_mask(name: str, layers: Mapping[str, ndarray]) -> Bool[ndarray, "h w"]:
    """Where a layer has a value: in the mask; without a mask, or for layers of the whole head, where it is not 0."""
    if name in WHOLE_PICTURE_LAYERS or "mask" not in layers:
        values = layers[name]
        return np.asarray(values.any(axis=-1) if values.ndim == 3 else values != 0)
    return np.asarray(layers["mask"])


def region_colour(index: int) -> tuple[int, int, int]:
    """A colour for each region. Hues are a golden section apart, so that consecutive regions differ."""
    hue = index * 0.618034 * 2 * np.pi
    red, green, blue = (round(140 + 100 * float(np.cos(hue - third * 2 * np.pi / 3))) for third in range(3))
    return red, green, blue


def _paint_mask(values: Shaped[ndarray, "h w"], where: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    return np.repeat(np.where(values, np.uint8(255), np.uint8(GREY))[..., None], 3, axis=2)


def _paint_coverage(values: Shaped[ndarray, "h w"], where: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    return np.repeat(np.rint(GREY + (255 - GREY) * values).astype(np.uint8)[..., None], 3, axis=2)


def _paint_depth(values: Shaped[ndarray, "h w"], where: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    picture = np.full((*values.shape, 3), GREY, dtype=np.uint8)
    if where.any():
        near, far = float(values[where].min()), float(values[where].max())
        shade = 255 * (1 - (values[where] - near) / max(far - near, 1e-6))  # near is bright
        picture[where] = shade[:, None].astype(np.uint8)
    return picture


def _paint_normals(values: Shaped[ndarray, "h w 3"], where: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    # As normal maps are usually shown: right is red, up green, towards the viewer blue.
    return map_picture((values * np.array([1, -1, -1])).astype(np.float32), where, 1.0)


def _paint_uv(values: Shaped[ndarray, "h w 2"], where: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    wrapped = (values % 1).astype(np.float32)  # some models continue into further tiles
    blue = np.full((*values.shape[:2], 1), 0.5, dtype=np.float32)
    return map_picture(np.concatenate([wrapped, blue], axis=2) - np.float32(0.5), where, 0.5)


def _paint_regions(values: Shaped[ndarray, "h w"], where: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    colours = np.array([(GREY,) * 3, *(region_colour(i) for i in range(255))], dtype=np.uint8)
    return colours[values]


_PAINTERS: dict[str, Callable[[ndarray, ndarray], ndarray]] = {
    "pncc": lambda values, where: map_picture(values, where, PNCC_LIMIT_MM),
    "offset": lambda values, where: map_picture(values, where, OFFSET_LIMIT_MM),
    "mask": _paint_mask,
    "depth": _paint_depth,
    "normals": _paint_normals,
    "uv": _paint_uv,
    "regions": _paint_regions,
    "seen": _paint_mask,
    "seen_regions": _paint_regions,
    "coverage": _paint_coverage,
}
