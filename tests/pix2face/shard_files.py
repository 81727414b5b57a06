"""Small samples for tests of shards."""

from pathlib import Path

import h5py
import hdf5plugin
import numpy as np

from pix2face.files.images import encode_image
from pix2face.geometry.camera import Camera
from pix2face.shards.layers import DEFAULT_LAYERS, LAYER_NAMES, LAYERS
from pix2face.shards.sample import Sample
from pix2face.shards.shard_reader import ShardHeader, ShardReader

HEADER = ShardHeader(
    model_name="synthetic",
    model_sha256="0" * 64,
    pncc_limit_mm=120.0,
    smallest_radius_mm=60.0,
    licence="CC0-1.0",
    configuration="{}",
    generator="test",
    layers=("image", "pncc", "offset", "mask", "depth", "landmarks"),
    region_names=("skin", "lips", "eyes"),
)


def make_triplet(seed: int, size: int = 24) -> Sample:
    """Noise within a rectangle: nothing about it is easy to predict."""
    rng = np.random.default_rng(seed)
    mask = np.zeros((size, size), dtype=bool)
    mask[4:-4, 6:-5] = True
    return Sample(
        sample_id=f"face/{seed}",
        image_bytes=encode_image(rng.integers(0, 256, (size, size, 3), dtype=np.uint8)),
        layers={
            "pncc": (rng.uniform(-119, 119, (size, size, 3)) * mask[..., None]).astype(np.float32),
            "offset": (rng.normal(0, 5, (size, size, 3)) * mask[..., None]).astype(np.float32),
            "mask": mask,
            "depth": (rng.uniform(300, 400, (size, size)) * mask).astype(np.float32),
        },
        camera=Camera(rng.normal(size=(4, 4))),
        identity=rng.normal(size=5),
        expression=rng.normal(size=3),
        landmarks2d=rng.uniform(0, size, (68, 2)),
        landmarks3d=rng.normal(0, 50, (68, 3)),
        visible=rng.random(68) > 0.5,
        attributes={"source": "test", "yaw_deg": 12.5},
    )


def every_layer(n: int) -> tuple[ShardHeader, list[Sample]]:
    """Samples of all layers that there are; regions reach beyond the mask, as a head does."""
    triplets = []
    for seed in range(n):
        rng, triplet = np.random.default_rng([seed, 1]), make_triplet(seed)
        mask = triplet.layers["mask"]
        normals = rng.normal(size=(*mask.shape, 3))
        normals *= mask[..., None] / np.linalg.norm(normals, axis=-1, keepdims=True)
        head = np.zeros_like(mask)
        head[1:-3, 2:-1] = True
        extra = {
            "normals": normals.astype(np.float32),
            "uv": (rng.uniform(0, 1, (*mask.shape, 2)) * mask[..., None]).astype(np.float32),
            "regions": (rng.integers(1, 4, mask.shape) * head).astype(np.uint8),
            "seen": mask & (rng.random(mask.shape) > 0.3),
            "seen_regions": rng.integers(0, 4, mask.shape).astype(np.uint8),
            "coverage": rng.integers(0, 256, mask.shape).astype(np.float32) / np.float32(255),
        }
        triplets.append(Sample(**{**vars(triplet), "layers": {**triplet.layers, **extra}}))
    return ShardHeader(**{**vars(HEADER), "layers": LAYER_NAMES}), triplets


def stored_layer(reader: ShardReader, index: int, name: str) -> np.ndarray:
    """A layer of the whole picture in steps."""
    return reader.stored(index, [name], is_whole=True)[name]


def as_earlier_versions_stored(path: Path, compression: str) -> None:
    """Turns a shard into one of schema 2, whose layers may also be plain (values in steps) or compressed by zstd."""
    filters = {"zstd": hdf5plugin.Zstd(clevel=3)}.get(compression, {"compression": "gzip", "compression_opts": 1})
    with h5py.File(path, "r+") as file:
        file.attrs["schema_version"] = 2
        file["header"] = file.attrs["header"]
        del file.attrs["header"]
        for name in [name for name in LAYERS if name in file or f"{name}_coded" in file]:
            dataset = file[name if name in file else f"{name}_coded"]
            values, attributes = dataset[()], dict(dataset.attrs)
            if compression == "plain" and attributes["predictor"] == b"planar":
                signed = ((values >> 1) ^ -(values & 1)).view(LAYERS[name].stored)
                values = signed.cumsum(1, dtype=signed.dtype).cumsum(2, dtype=signed.dtype)
                attributes["predictor"] = np.bytes_("none")
            del file[dataset.name]
            chunks, shuffle = (1, *values.shape[1:]), values.dtype.itemsize > 1
            file.create_dataset(name, data=values, chunks=chunks, shuffle=shuffle, **filters).attrs.update(attributes)
        if "image" in file:
            lengths = file["image_length"][()]
            images = [row[:length].tobytes() for row, length in zip(file["image"][()], lengths, strict=True)]
            file["image_bytes"] = np.frombuffer(b"".join(images), np.uint8)
            file["image_end"] = lengths.cumsum(dtype=np.int64)
            del file["image"], file["image_length"]


assert set(DEFAULT_LAYERS) < set(HEADER.layers)
