"""Predicted maps as files: ``.npz``, 16-bit PNG and OpenEXR (layouts: docs/reference/file_formats.md)."""

import json
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, UInt16
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.files.images import encode_exr, encode_image
from pix2face.files.writing import write_file
from pix2face.inference.predictor import Prediction

# 16-bit PNG: code = 128 mm + 32768, so a step is 1/128 mm; 0 is kept for pixels outside the mask.
PNG16_STEPS_PER_MM = 128
PNG16_ZERO = 32768


def parse_formats(text: str) -> tuple[str, ...]:
    """The formats in a list such as ``npz,exr``.

    Raises:
        UsageError: A format is not known, or none is given.
    """
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    if not set(names) <= set(MAP_FORMATS):
        raise UsageError(f"expected --format to list some of {', '.join(MAP_FORMATS)}, found {text!r}")
    return names


def maps_to_png16(values_mm: Float32[ndarray, "h w 3"], mask: Bool[ndarray, "h w"]) -> UInt16[ndarray, "h w 3"]:
    """Millimetres as 16-bit codes: mm * 128 + 32768, and 0 outside the mask.

    Raises:
        DegenerateGeometryError: A value lies beyond what 16 bits hold, about 256 mm.
    """
    codes = np.rint(values_mm[mask].astype(np.float64) * PNG16_STEPS_PER_MM) + PNG16_ZERO
    if not ((codes >= 1) & (codes <= 65535)).all():  # also catches NaN
        raise DegenerateGeometryError(
            f"expected maps within ±{PNG16_ZERO // PNG16_STEPS_PER_MM} mm for 16-bit PNG, found values up to "
            f"{np.abs(values_mm[mask]).max():.0f} mm; is this a trained network? --format npz or exr holds any value"
        )
    coded = np.zeros(values_mm.shape, dtype=np.uint16)
    coded[mask] = codes.astype(np.uint16)
    return coded


def _write_npz(folder: Path, name: str, prediction: Prediction) -> None:
    maps = prediction.maps
    content = BytesIO()
    np.savez_compressed(
        content,
        pncc=maps.pncc,
        offset=maps.offset,
        mask=maps.mask,
        image_from_crop=prediction.crop.image_from_crop,
        box_px=np.array(prediction.box.sides),
        score=np.array(np.nan if prediction.score is None else prediction.score),
    )
    write_file(folder / f"{name}.npz", content.getvalue())


def _write_png16(folder: Path, name: str, prediction: Prediction) -> None:
    maps = prediction.maps
    pncc, offset = (maps_to_png16(values, maps.mask) for values in (maps.pncc, maps.offset))
    planes = {"pncc": pncc, "offset": offset, "mask": maps.mask.astype(np.uint8) * 255}  # x, y, z as red, green, blue
    for suffix, plane in planes.items():
        write_file(folder / f"{name}-{suffix}.png", encode_image(plane))
    crop = {
        "image_from_crop": prediction.crop.image_from_crop.tolist(),
        "size_px": prediction.crop.size_px,
        "box_px": prediction.box.sides,
        "score": prediction.score,
    }
    write_file(folder / f"{name}-crop.json", json.dumps(crop, indent=1))


def _write_exr(folder: Path, name: str, prediction: Prediction) -> None:
    maps = prediction.maps
    channels = {
        f"{layer}.{axis}": values[..., k]
        for layer, values in (("pncc", maps.pncc), ("offset", maps.offset))
        for k, axis in enumerate("XYZ")
    }
    channels["mask"] = maps.mask.astype(np.float32)
    attributes = {
        "unit": "mm",
        "image_from_crop": prediction.crop.image_from_crop,
        "box_px": tuple(np.array(prediction.box.sides, dtype=np.float32).reshape(2, 2)),
        **({} if prediction.score is None else {"score": float(prediction.score)}),
    }
    write_file(folder / f"{name}.exr", encode_exr(channels, attributes))


# Each writes the maps of one face under a name in a folder.
MAP_FORMATS: Mapping[str, Callable[[Path, str, Prediction], None]] = {
    "npz": _write_npz,
    "png16": _write_png16,
    "exr": _write_exr,
}
