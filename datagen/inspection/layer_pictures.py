"""Layers as pictures that people can read."""

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Bool, Shaped, UInt8
from numpy import ndarray

from pix2face.geometry.maps import map_picture
from pix2face.shards.layers import WHOLE_PICTURE_LAYERS

# What the ends of the colours stand for, mm.
PNCC_LIMIT_MM, OFFSET_LIMIT_MM = 120.0, 15.0
GREY = 128


def layer_picture(name: str, layers: Mapping[str, ndarray]) -> UInt8[ndarray, "h w 3"]:
    """Draws one layer of a sample; grey where it does not hold.

    Args:
        name: Of the layer.
        layers: Of the sample, by name, in the units of ``pix2face.shards.layers``.
    """
    where = layer_mask(name, layers)
    return _PAINTERS[name](layers[name], where)


def layer_mask(name: str, layers: Mapping[str, ndarray]) -> Bool[ndarray, "h w"]:
    """Where a layer holds: in the mask, or on the whole head; where it is not 0 if there is no mask."""
    if name in WHOLE_PICTURE_LAYERS or "mask" not in layers:
        values = layers[name]
        return np.asarray(values.any(axis=-1) if values.ndim == 3 else values != 0)
    return np.asarray(layers["mask"])


def region_colour(index: int) -> tuple[int, int, int]:
    """A colour for each region: hues a golden section apart, so that neighbours in number differ."""
    hue = index * 0.618034 * 2 * np.pi
    red, green, blue = (round(140 + 100 * float(np.cos(hue - third * 2 * np.pi / 3))) for third in range(3))
    return red, green, blue


def _paint_pncc(values: Shaped[ndarray, "h w 3"], where: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    return map_picture(values, where, PNCC_LIMIT_MM)


def _paint_offset(values: Shaped[ndarray, "h w 3"], where: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    return map_picture(values, where, OFFSET_LIMIT_MM)


def _paint_mask(values: Shaped[ndarray, "h w"], where: Bool[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    return np.repeat(np.where(values, np.uint8(255), np.uint8(GREY))[..., None], 3, axis=2)


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
    "pncc": _paint_pncc,
    "offset": _paint_offset,
    "mask": _paint_mask,
    "depth": _paint_depth,
    "normals": _paint_normals,
    "uv": _paint_uv,
    "regions": _paint_regions,
    "seen": _paint_mask,
    "seen_regions": _paint_regions,
}
