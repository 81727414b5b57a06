"""Writing shards, and checking them."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.face_maps import FIXED_POINT_STEPS_PER_MM, maps_to_fixed_point
from pix2face.images import decode_image
from pix2face.shards import (
    DEPTH_STEPS_PER_MM,
    FORMAT,
    PER_SAMPLE,
    SCHEMA_VERSION,
    ShardHeader,
    ShardReader,
    Triplet,
    sample_checksum,
)


def write_shard(path: Path, header: ShardHeader, triplets: Sequence[Triplet]) -> None:
    """Writes a shard under a temporary name, reads it back, and renames it.

    Args:
        path: Where it goes; its folder is made.
        header: What holds for all samples.
        triplets: The samples, all of one model. May be empty.

    Raises:
        InputFileError: A value does not fit the format, or what was written does not read back.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.part")
    try:
        with h5py.File(temporary, "w", track_order=False) as file:
            _write_header(file, header)
            _write_samples(file, triplets)
        problems = verify_shard(temporary)
        if problems:
            raise InputFileError(f"{path}: written, but does not read back: {problems[0]}; is the disk sound?")
        temporary.rename(path)
    finally:
        temporary.unlink(missing_ok=True)


def verify_shard(path: Path) -> list[str]:
    """Reads every sample of a shard and checks it.

    Returns:
        What is wrong with it, in words; empty where nothing is.
    """
    problems = []
    try:
        with ShardReader(path) as reader:
            if len(set(reader.sample_ids)) < len(reader):
                problems.append("sample ids are not unique")
            for index in range(len(reader)):
                problems += [f"sample {reader.sample_ids[index]!r}: {text}" for text in _sample_problems(reader, index)]
    except InputFileError as error:
        problems.append(str(error))
    return problems


def _sample_problems(reader: ShardReader, index: int) -> list[str]:
    triplet = reader.triplet(index)
    maps, problems = triplet.maps, []
    image = decode_image(triplet.image, f"{reader.path}, sample {index}")
    if image.shape[:2] != maps.mask.shape:
        problems.append(f"the picture is {image.shape[:2]}, the maps are {maps.mask.shape}")
    if not maps.mask.any():
        problems.append("the mask is empty")
    for name, values in (("PNCC", maps.pncc), ("offset", maps.offset), ("depth", triplet.depth)):
        if values[~maps.mask].any():
            problems.append(f"{name} is not 0 outside the mask")
    if not np.abs(maps.pncc).max(initial=0) <= reader.header.pncc_limit_mm + 0.01:
        problems.append(f"PNCC exceeds the model's {reader.header.pncc_limit_mm:.1f} mm")
    stored, found = reader.checksum_pair(index)
    if stored != found:
        problems.append("the checksum differs: the content has changed since it was written")
    arrays = ("identity", "expression", "landmarks2d", "landmarks3d")
    return problems + [f"{name} is not finite" for name in arrays if not np.isfinite(getattr(triplet, name)).all()]


def _write_header(file: h5py.File, header: ShardHeader) -> None:
    file.attrs["format"] = FORMAT
    file.attrs["schema_version"] = SCHEMA_VERSION
    file.attrs["header"] = json.dumps(asdict(header), sort_keys=True)
    file.attrs["fixed_point_steps_per_mm"] = FIXED_POINT_STEPS_PER_MM
    file.attrs["depth_steps_per_mm"] = DEPTH_STEPS_PER_MM


def _write_samples(file: h5py.File, triplets: Sequence[Triplet]) -> None:
    n = len(triplets)
    # Pictures of several sizes share one shape; what lies beyond a picture's own size compresses to nothing.
    shapes = [triplet.maps.mask.shape for triplet in triplets]
    height, width = (max(lengths, default=0) for lengths in zip(*shapes, strict=True)) if n else (0, 0)
    _create(file, "pncc", n, (height, width, 3), np.int16)
    _create(file, "offset", n, (height, width, 3), np.int16)
    _create(file, "mask", n, (height, width), np.uint8)
    _create(file, "depth", n, (height, width), np.int32)
    for name, dtype in PER_SAMPLE.items():
        first = _per_sample(triplets[0], name) if n else np.zeros(0)
        _create(file, name, n, first.shape, dtype)
    file.create_dataset("image", (n,), dtype=h5py.vlen_dtype(np.uint8), track_times=False)
    for name in ("sample_id", "attributes", "checksum"):
        file.create_dataset(name, (n,), dtype=h5py.string_dtype(), track_times=False)
    file.create_dataset("size_px", (n, 2), dtype=np.int32, track_times=False)
    file.create_dataset("offset_limit_mm", (n,), dtype=np.float32, track_times=False)
    for index, triplet in enumerate(triplets):
        _write_sample(file, index, triplet)


def _write_sample(file: h5py.File, index: int, triplet: Triplet) -> None:
    height, width = triplet.maps.mask.shape
    file["size_px"][index] = height, width
    file["pncc"][index, :height, :width] = maps_to_fixed_point(triplet.maps.pncc)
    file["offset"][index, :height, :width] = maps_to_fixed_point(triplet.maps.offset)
    file["mask"][index, :height, :width] = triplet.maps.mask
    file["depth"][index, :height, :width] = np.rint(triplet.depth * DEPTH_STEPS_PER_MM).astype(np.int32)
    for name in PER_SAMPLE:
        file[name][index] = _per_sample(triplet, name)
    file["image"][index] = np.frombuffer(triplet.image, dtype=np.uint8)
    file["sample_id"][index] = triplet.sample_id
    file["attributes"][index] = json.dumps(dict(triplet.attributes), sort_keys=True)
    file["offset_limit_mm"][index] = np.abs(triplet.maps.offset).max(initial=0)
    file["checksum"][index] = sample_checksum(file, index)


def _per_sample(triplet: Triplet, name: str) -> ndarray:
    return triplet.camera.matrix if name == "camera" else np.asarray(getattr(triplet, name))


def _create(file: h5py.File, name: str, n: int, shape: tuple[int, ...], dtype: Any) -> None:
    # One chunk a sample: random access decodes nothing but the sample asked for.
    options: dict[str, Any] = {}
    if n and all(shape):
        options = {"chunks": (1, *shape), "compression": "gzip", "compression_opts": 4, "shuffle": True}
    file.create_dataset(name, (n, *shape), dtype=dtype, track_times=False, **options)
