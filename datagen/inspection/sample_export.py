"""Samples as picture files for other programs: one multilayer OpenEXR a sample, or 16-bit PNG files.

docs/reference/file_formats.md lists channels, files and units.
"""

import json
from collections.abc import Callable, Mapping
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Shaped, UInt8, UInt16
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.files.images import encode_exr, encode_image, srgb_to_linear
from pix2face.files.writing import write_file
from pix2face.shards.layers import LAYERS
from pix2face.shards.sample import Sample
from pix2face.shards.shard_reader import ShardReader, shard_paths

# What compositors call the layers: the names of Arnold and RenderMan for rest positions and normals, OpenEXR's standard
# name for depth. Other layers keep the names that shards have.
EXR_NAMES: Mapping[str, str] = {"pncc": "Pref", "normals": "N", "depth": "Z", "uv": "UV"}
EXR_AXES: Mapping[str, str] = {"pncc": "XYZ", "offset": "XYZ", "normals": "XYZ", "uv": "UV"}
# From the camera frame (y down, z forward) to that of compositors (y up, z towards the viewer).
NORMAL_SIGNS = np.array([1, -1, -1], dtype=np.float32)
# PNG: code = value * steps + zero, so that 0 is kept for pixels outside the mask where there is a zero.
PNG_STEPS: Mapping[str, float] = {"pncc": 128, "offset": 128, "normals": 32767, "uv": 65534, "depth": 8}
PNG_ZERO: Mapping[str, int] = {"pncc": 32768, "offset": 32768, "normals": 32768, "uv": 1, "depth": 0}


def export_samples(folder: Path, out: Path, file_format: str, on_sample: Callable[[bool], None]) -> None:
    """Writes the files of every sample. What an earlier run has finished is kept.

    The file ``NUMBER.json`` is written last, and contains the checksum of the sample. ``out`` exists; the format is a
    name of ``EXPORTS``. ``on_sample`` is called after each sample, with whether an earlier run had finished it.

    Raises:
        UsageError: There are no shards, ``out`` contains other samples, or a file cannot be written.
        InputFileError: A sample is damaged, or PNG files cannot hold its values.
    """
    numbers = count()
    for path in shard_paths(folder):
        reader = ShardReader(path)
        for index, checksum in enumerate(reader.column("checksum").tolist()):
            name, key = f"{next(numbers):06d}", {"format": file_format, "checksum": checksum}
            description = out / f"{name}.json"
            is_done = description.exists()
            if is_done:
                _check_same(description, key)
            else:
                sample = reader.read(index)
                EXPORTS[file_format](out, name, sample)
                write_file(description, json.dumps({**key, **_described(sample)}, indent=1))
            on_sample(is_done)


def _check_same(description: Path, key: Mapping[str, Any]) -> None:
    try:
        content = json.loads(description.read_bytes())
        is_same = all(content.get(name) == value for name, value in key.items())
    except (OSError, ValueError, AttributeError):
        is_same = False
    if not is_same:
        raise UsageError(
            f"{description}: expected the same sample and --format as before, found a file of another export; "
            "choose another --out, or delete the folder"
        )


def _described(sample: Sample) -> dict[str, Any]:
    """What pictures cannot hold."""
    return {
        "sample_id": sample.sample_id,
        "camera": sample.camera.matrix.tolist(),
        "landmarks2d_px": np.round(sample.landmarks2d.astype(np.float64), 4).tolist(),
        "landmarks3d_mm": np.round(sample.landmarks3d.astype(np.float64), 4).tolist(),
        "landmarks_visible": sample.visible.tolist(),
        "identity": sample.identity.tolist(),
        "expression": sample.expression.tolist(),
        "attributes": dict(sample.attributes),
    }


def _export_exr(out: Path, name: str, sample: Sample) -> None:
    channels = {}
    if sample.image_bytes is not None:
        linear = srgb_to_linear(sample.image.astype(np.float32) / 255).astype(np.float16)
        channels = {channel: linear[..., k] for k, channel in enumerate("RGB")}
    for layer, values in sample.layers.items():
        shown = values * NORMAL_SIGNS if layer == "normals" else values
        planes = shown[..., None] if shown.ndim == 2 else shown
        kind = np.uint32 if values.dtype == np.uint8 else np.float32
        for k, plane in enumerate(np.moveaxis(planes, -1, 0)):
            axis = f".{EXR_AXES[layer][k]}" if layer in EXR_AXES else ""
            channels[f"{EXR_NAMES.get(layer, layer)}{axis}"] = plane.astype(kind)
    attributes = {"unit": "mm", "sample_id": sample.sample_id, "camera": sample.camera.matrix}
    write_file(out / f"{name}.exr", encode_exr(channels, attributes))


def _export_png(out: Path, name: str, sample: Sample) -> None:
    if sample.image_bytes is not None:
        suffix = "jpg" if sample.image_bytes.startswith(b"\xff\xd8") else "png"
        write_file(out / f"{name}.{suffix}", sample.image_bytes)
    mask = sample.layers.get("mask")
    for layer, values in sample.layers.items():
        plane = _codes(layer, values, mask, sample.sample_id) if layer in PNG_STEPS else _bytes_of(layer, values)
        if plane.ndim == 3 and plane.shape[2] == 2:  # PNG has no two channels: blue stays empty
            plane = np.dstack([plane, np.zeros_like(plane[..., :1])])
        write_file(out / f"{name}-{EXR_NAMES.get(layer, layer)}.png", encode_image(plane))


def _codes(
    layer: str, values: Shaped[ndarray, "h w *c"], mask: Shaped[ndarray, "h w"] | None, sample_id: str
) -> UInt16[ndarray, "h w *c"]:
    signed = values * NORMAL_SIGNS if layer == "normals" else values
    codes = np.rint(signed.astype(np.float64) * PNG_STEPS[layer]) + PNG_ZERO[layer]
    if mask is not None:
        codes[~mask] = 0
    if codes.min(initial=0) < 0 or codes.max(initial=0) > 65535:
        raise InputFileError(
            f"{sample_id}: expected {layer} that 16-bit PNG holds, found values up to {np.abs(values).max():.0f} "
            f"{LAYERS[layer].unit}; use --format exr"
        )
    return codes.astype(np.uint16)


def _bytes_of(layer: str, values: Shaped[ndarray, "h w"]) -> UInt8[ndarray, "h w"]:
    """Masks are 0 and 255, shares 0 to 255, and numbers of regions stay as they are."""
    return values if values.dtype == np.uint8 else np.rint(values.astype(np.float32) * 255).astype(np.uint8)


# Each writes the files of one sample.
EXPORTS: Mapping[str, Callable[[Path, str, Sample], None]] = {"exr": _export_exr, "png": _export_png}
