"""What a shard's file holds, and the checks that a file is laid out so (docs/reference/file_formats.md)."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, final

import h5py
import numpy as np
from isal import isal_zlib
from jaxtyping import Int
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.face_files.coefficients import LARGEST_SIDE_PX
from pix2face.files.checked_hdf5 import check_contained, filters_of, read_text, read_version
from pix2face.files.json_text import JsonObject, Positive, parse_json, typed
from pix2face.shards.image_storage import check_images
from pix2face.shards.layers import DEFAULT_LAYERS, IMAGE, LAYER_NAMES, LAYERS, WHOLE_PICTURE_LAYERS
from pix2face.shards.map_storage import Box

FORMAT = "pix2face-shard"
SCHEMA_VERSION = 3
# Schema 2 had no name of its own for layers that the predictor has changed, and datasets that are not one row a sample.
OLDEST_SCHEMA = 2
# HDF5 keeps the numbers up to this for its own filters.
LARGEST_OWN_FILTER = 255
# Id and reason of each sample that was rejected.
Rejected = list[tuple[str, str]]
# The attribute "predictor" of a layer.
PREDICTED, PLAIN = "planar", "none"
# What the predictor leaves looks like values, and so has another name.
CODED = "_coded"
# Smooth layers as plain values: as they are in memory, and rounded to the same steps.
PLAIN_VALUES = {name: replace(layer, stored=np.dtype("<f4")) for name, layer in LAYERS.items() if layer.is_smooth}


@final
@dataclass(frozen=True, kw_only=True)
class ShardHeader:
    """What holds for every sample of a shard."""

    model_name: str  # the morphable model that the maps refer to
    model_sha256: str
    pncc_limit_mm: Positive  # largest coordinate of the mean face: PNCC divided by it stays within ±1
    smallest_radius_mm: Positive  # from the origin to the nearest point of the mean face
    licence: str  # terms of the pictures and of the model
    configuration: str  # of the job, resolved, as JSON
    generator: str  # program and version
    rejected: str = "[]"  # the samples of this unit of work that could not be used, as JSON: id and reason
    layers: tuple[str, ...] = DEFAULT_LAYERS  # what each sample has, of `layers.LAYER_NAMES`
    region_names: tuple[str, ...] = ()  # what the layer `regions` counts
    # Why samples cannot be mirrored; empty where they can.
    mirror_obstacle: str = "nobody said whether the model is symmetric"

    def to_json(self) -> str:
        """The text that a shard stores."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> "ShardHeader":
        """Reads the text of a shard.

        Raises:
            ValueError: It is not a header of this format.
        """
        fields = parse_json(text, JsonObject)
        if fields.keys() != cls.__dataclass_fields__.keys():
            raise ValueError(f"the header is not an object of {', '.join(cls.__dataclass_fields__)}")
        header: ShardHeader = typed(fields, cls)
        if set(header.layers) - {*LAYER_NAMES} or len(set(header.layers)) < len(header.layers):
            raise ValueError(f"the header names layers {header.layers}, known are {', '.join(LAYER_NAMES)}")
        for name, kind in (("configuration", JsonObject), ("rejected", Rejected)):
            try:
                parse_json(getattr(header, name), kind)
            except ValueError as error:
                raise ValueError(f"the header's {name}: {error}") from error
        return header

    @property
    def rejected_samples(self) -> Rejected:
        """`rejected`, parsed."""
        return parse_json(self.rejected, Rejected)


@final
@dataclass(frozen=True)
class Column:
    """A small array that every sample has."""

    dtype: Any  # as stored
    shape: tuple[int | None, ...]  # of one sample; None is any length, the same in the whole shard


# What belongs to the content of a sample, in the order of its checksum.
CONTENT_COLUMNS: Mapping[str, Column] = {
    "camera": Column(np.dtype("<f8"), (4, 4)),
    "identity": Column(np.dtype("<f4"), (None,)),
    "expression": Column(np.dtype("<f4"), (None,)),
    "landmarks2d": Column(np.dtype("<f4"), (None, 2)),
    "landmarks3d": Column(np.dtype("<f4"), (None, 3)),
    "visible": Column(np.dtype("u1"), (None,)),
}
COLUMNS: Mapping[str, Column] = {
    **CONTENT_COLUMNS,
    "size_px": Column(np.dtype("<i4"), (2,)),
    "box_px": Column(np.dtype("<i4"), (4,)),
    "offset_limit_mm": Column(np.dtype("<f4"), ()),
    "checksum": Column(np.dtype("<u4"), ()),
}
TEXTS = ("sample_id", "attributes")


def layer_boxes(names: Iterable[str], box_px: Int[ndarray, "4"], size_px: tuple[int, int]) -> dict[str, Box]:
    """Where each layer is not 0: in the mask's bounding box (top, left, bottom, right), or anywhere in the picture."""
    top, left, bottom, right = box_px.tolist()
    face, everywhere = np.s_[top:bottom, left:right], np.s_[0 : size_px[0], 0 : size_px[1]]
    return {name: everywhere if name in WHOLE_PICTURE_LAYERS else face for name in names}


def content_checksum(stored: Mapping[str, Any], boxes: Mapping[str, Box], size_px: tuple[int, int]) -> int:
    """CRC-32 (as ``zlib.crc32``) of a sample's content: layers in steps, picture, columns and attributes.

    It does not depend on how the content is compressed, nor on the size that a shard pads its layers to.

    Args:
        stored: Layers in the order of the header, each in its box; the bytes of picture (if any) and attributes; the
            rows of ``CONTENT_COLUMNS``.
        boxes: Rows and columns of each layer outside which it is 0.
        size_px: Height and width of the sample.
    """
    checksum = 0
    for name, box in boxes.items():
        whole = np.zeros(LAYERS[name].shape(*size_px), dtype=LAYERS[name].stored)
        whole[box] = stored[name]
        checksum = isal_zlib.crc32(whole, checksum)
    checksum = isal_zlib.crc32(stored.get(IMAGE, b""), checksum)
    for name, column in CONTENT_COLUMNS.items():
        checksum = isal_zlib.crc32(np.ascontiguousarray(stored[name], dtype=column.dtype).tobytes(), checksum)
    return isal_zlib.crc32(stored["attributes"], checksum)


def open_datasets(file: h5py.File, path: Path) -> Mapping[str, h5py.Dataset]:
    """Checks that this is a shard of a known schema, and that all its data is in it.

    Returns:
        Its datasets, layers under their own names, coded or not. Each is opened once: that takes longer than to read a
        small one.

    Raises:
        InputFileError: It is not, or it is damaged.
    """
    found = _format_name(file, path)
    if found != FORMAT:
        raise InputFileError(f"{path}: expected a shard (format={FORMAT!r}), found format={found!r}")
    version = read_version(file.attrs, path)
    if version > SCHEMA_VERSION:
        raise InputFileError(
            f"{path}: shard schema {version} is newer than {SCHEMA_VERSION}, which this version reads; upgrade pix2face"
        )
    if version < OLDEST_SCHEMA:
        raise InputFileError(
            f"{path}: expected shard schema {OLDEST_SCHEMA} or {SCHEMA_VERSION}, found {version}, made by an earlier "
            "version; delete the folder and run `datagen render` again"
        )
    names = (IMAGE, *LAYERS, *(f"{name}{CODED}" for name in PLAIN_VALUES))
    check_contained(file, path, sliced=tuple(f"/{name}" for name in names))
    datasets = dict(file.items())
    strange = [name for name, item in datasets.items() if not isinstance(item, h5py.Dataset)]
    if strange:
        raise ValueError(f"{strange[0]} is no dataset")
    for name in PLAIN_VALUES:
        datasets[name] = datasets.pop(f"{name}{CODED}", datasets.get(name))
        if datasets[name] is None:
            del datasets[name]
        elif version > OLDEST_SCHEMA and is_predicted(datasets[name]) != datasets[name].name.endswith(CODED):
            raise ValueError(f"the predictor of {datasets[name].name} is not the one that its name says")
    return datasets


def read_header(file: h5py.File, datasets: Mapping[str, h5py.Dataset], path: Path) -> ShardHeader:
    """Reads the header, which is an attribute of the file, or a dataset in schema 2.

    Raises:
        InputFileError: There is none.
        ValueError: It is not a header of this format.
    """
    is_old = read_version(file.attrs, path) == OLDEST_SCHEMA
    return ShardHeader.from_json(
        read_text(datasets["header"], path) if is_old else read_text(file.attrs, path, "header")
    )


def check_layout(datasets: Mapping[str, h5py.Dataset], layers: Sequence[str]) -> None:
    """Checks type and shape of every dataset.

    Raises:
        ValueError: One is not as this format has it.
    """
    n = len(datasets["sample_id"])
    for name, column in COLUMNS.items():
        dataset = datasets[name]
        shape = (n, *column.shape)
        fits = len(dataset.shape) == len(shape) and all(
            a in (None, b) for a, b in zip(shape, dataset.shape, strict=True)
        )
        if not fits or dataset.dtype != column.dtype:
            raise ValueError(f"{name} is {dataset.dtype} {dataset.shape}, expected {column.dtype} {shape}")
    counts = {name: datasets[name].shape[1] for name in ("landmarks2d", "landmarks3d", "visible")}
    if len(set(counts.values())) > 1:
        raise ValueError(f"the numbers of landmarks differ: {counts}")
    for name in TEXTS:
        if datasets[name].dtype.kind != "S" or datasets[name].shape != (n,):
            raise ValueError(
                f"{name} is {datasets[name].dtype} {datasets[name].shape}, expected fixed-length text ({n},)"
            )
    if IMAGE in layers:
        check_images(datasets, n)
    sizes = {_layer_size(datasets, name, n) for name in layers if name in LAYERS}
    if len(sizes) > 1:
        raise ValueError(f"layers are of different sizes: {sorted(sizes)}")
    largest = np.array(sizes.pop() if sizes else (0, 0))
    size_px, box_px = datasets["size_px"][()], datasets["box_px"][()]
    if ((size_px < 0) | (size_px > largest)).any():
        raise ValueError(f"size_px exceeds the layers' {largest.tolist()}")
    if not ((box_px[:, :2] >= 0) & (box_px[:, :2] <= box_px[:, 2:]) & (box_px[:, 2:] <= size_px)).all():
        raise ValueError("box_px is not within size_px")


def _format_name(file: h5py.File, path: Path) -> str | None:
    if "format" not in file.attrs:
        return None
    if file.attrs.get_id("format").dtype.kind == "S":
        return read_text(file.attrs, path, "format")
    # Schema 1 had text of variable length, which is not read here: damaged, it could end the process.
    return FORMAT if "offset_limit_mm" in file else "of variable length"


def is_predicted(dataset: h5py.Dataset) -> bool:
    """Whether a layer is stored as what the predictor leaves.

    Raises:
        ValueError: The dataset does not say.
    """
    kind = dataset.attrs.get_id("predictor").dtype.kind if "predictor" in dataset.attrs else ""
    found = bytes(dataset.attrs["predictor"]) if kind == "S" else b""
    if found not in (PREDICTED.encode(), PLAIN.encode()):
        raise ValueError(f"{dataset.name} has the predictor {found!r}, expected {PREDICTED} or {PLAIN}")
    return found == PREDICTED.encode()


def has_foreign_filter(dataset: h5py.Dataset) -> bool:
    """Whether a dataset needs a filter that is not one of HDF5's own."""
    return any(code > LARGEST_OWN_FILTER for code in filters_of(dataset))


def _layer_size(datasets: Mapping[str, h5py.Dataset], name: str, n: int) -> tuple[int, int]:
    dataset, layer = datasets[name], LAYERS[name]
    shape = dataset.shape
    stored = [layer.stored, PLAIN_VALUES[name].stored] if name in PLAIN_VALUES else [layer.stored]
    if is_predicted(dataset):
        stored = [np.dtype(f"<u{layer.stored.itemsize}")]
    height, width = shape[1:3] if len(shape) >= 3 else (-1, -1)
    chunk = (1, *shape[1:]) if all(shape) else None
    if (
        dataset.dtype not in stored
        or shape != (n, *layer.shape(height, width))
        or not 0 <= height <= LARGEST_SIDE_PX
        or not 0 <= width <= LARGEST_SIDE_PX
        or dataset.chunks != chunk
    ):
        raise ValueError(f"{name} is {dataset.dtype} {shape} in chunks of {dataset.chunks}, expected one a sample")
    return height, width
