"""Writing shards: samples are packed one by one, then written together, read back and renamed."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, final

import h5py
import numpy as np
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.files.checked_hdf5 import fixed_text
from pix2face.files.text_columns import bounded_utf8
from pix2face.files.writing import written_in_one_step
from pix2face.geometry.maps import face_box
from pix2face.shards.compressions import DEFAULT_COMPRESSION, Compression, create_layer_dataset, find_compression
from pix2face.shards.layers import IMAGE, LANDMARKS, LAYERS, to_stored
from pix2face.shards.map_storage import pack_layer, unpack_layer
from pix2face.shards.shard_layout import (
    COLUMNS,
    CONTENT_COLUMNS,
    FORMAT,
    SCHEMA_VERSION,
    content_checksum,
    layer_box,
    layer_checksum,
)
from pix2face.shards.shard_reader import ShardHeader
from pix2face.shards.triplet import Triplet

# Text has a fixed length for each shard: the longest of its samples decides, so one must not be without bounds.
LARGEST_TEXT_BYTES = {"sample_id": 4096, "attributes": 16384}


@final
@dataclass(frozen=True, eq=False)
class PackedTriplet:
    """A sample as a shard holds it: a tenth of the memory of a Triplet.

    Attributes:
        texts: ``sample_id`` and ``attributes``, UTF-8.
        image: Content of a picture's file; empty where the set has none.
        chunks: The compressed layers, by name.
        size_px: Height and width of the layers.
        columns: The rows that go into ``pix2face.shards.shard_layout.COLUMNS``.
    """

    texts: Mapping[str, bytes]
    image: bytes
    chunks: Mapping[str, bytes]
    size_px: tuple[int, int]
    columns: Mapping[str, ndarray]


def pack_triplet(triplet: Triplet, layers: Sequence[str]) -> PackedTriplet:
    """Rounds and compresses one sample.

    Args:
        triplet: The sample. Where it has a mask, what its layers hold outside the mask's bounding box is taken to be 0
            (but for layers of the whole head).
        layers: What to keep of it: names of ``pix2face.shards.layers.LAYER_NAMES``.

    Raises:
        InputFileError: It lacks a layer, or a value does not fit the format.
    """
    image = _image(triplet) if IMAGE in layers else b""
    attributes = json.dumps(dict(triplet.attributes), sort_keys=True, separators=(",", ":"))
    texts = {
        name: bounded_utf8(text, name, LARGEST_TEXT_BYTES[name])
        for name, text in (("sample_id", triplet.sample_id), ("attributes", attributes))
    }
    chunks, size_px, known = _pack_layers(triplet, [name for name in layers if name in LAYERS])
    columns = {**_content_columns(triplet, LANDMARKS in layers), **known, "size_px": np.array(size_px)}
    columns["checksum"] = np.array(content_checksum(known["checksum"], image, columns, texts["attributes"]))
    return PackedTriplet(texts, image, chunks, size_px, columns)


def write_shard(
    path: Path, header: ShardHeader, triplets: Iterable[Triplet], compression: str = DEFAULT_COMPRESSION
) -> None:
    """Writes a shard under a temporary name, reads it back, and renames it.

    Args:
        path: Where it goes; its folder is made.
        header: What holds for all samples; its ``layers`` are kept, others are not.
        triplets: The samples, all of one model. May be empty.
        compression: Of the layers: a name of ``pix2face.shards.compressions.COMPRESSIONS``.

    Raises:
        InputFileError: A value does not fit the format, or what was written does not read back.
        UsageError: The file cannot be written, for instance since the disk is full.
    """
    write_packed(path, header, [pack_triplet(triplet, header.layers) for triplet in triplets], compression)


def write_packed(
    path: Path, header: ShardHeader, samples: Sequence[PackedTriplet], compression: str = DEFAULT_COMPRESSION
) -> None:
    """As ``write_shard``, of samples that were packed as they were made: a whole shard of them fits in memory.

    The file is put together in memory and written in one go, so a full disk is an ordinary error; inside the HDF5
    library it is not.

    Args:
        path: Where it goes; its folder is made.
        header: What holds for all samples.
        samples: Packed with the layers that ``header`` names.
        compression: As in ``write_shard``.

    Raises:
        InputFileError: Ids are not unique, samples do not match, or what was written does not read back.
        UsageError: The file cannot be written, for instance since the disk is full.
    """
    content = _file_content(header, samples, find_compression(compression))
    try:
        # Two workers may have the same shard to make.
        with written_in_one_step(path, is_contended=True) as temporary:
            temporary.write_bytes(content)
            _check_written(temporary, content, path)
    except OSError as error:
        raise UsageError(
            f"{path}: expected to write {len(content) / 1e6:.1f} MB, found that it cannot be ({error.strerror}); "
            "make room or choose another folder, and run the same command again: finished shards are kept"
        ) from error


def _file_content(header: ShardHeader, samples: Sequence[PackedTriplet], compression: Compression) -> bytes:
    ids = [sample.texts["sample_id"] for sample in samples]
    if len(set(ids)) < len(ids):
        raise InputFileError("expected unique sample ids in a shard, found that sample ids are not unique")
    with h5py.File("shard", "w", driver="core", backing_store=False, track_order=False) as file:
        file.attrs["format"] = fixed_text(FORMAT)
        file.attrs["schema_version"] = SCHEMA_VERSION
        file["header"] = fixed_text(json.dumps(asdict(header), sort_keys=True))
        for name in ("sample_id", "attributes"):
            _write_texts(file, name, [sample.texts[name] for sample in samples])
        for name in COLUMNS:
            _write_column(file, name, [sample.columns[name] for sample in samples])
        if IMAGE in header.layers:
            _write_images(file, [sample.image for sample in samples])
        _write_layers(file, [name for name in header.layers if name in LAYERS], samples, compression)
        file.flush()
        return bytes(file.id.get_file_image())


def _write_texts(file: h5py.File, name: str, texts: Sequence[bytes]) -> None:
    kind = h5py.string_dtype("utf-8", max([1, *map(len, texts)]))
    file.create_dataset(name, data=np.array(texts, dtype=kind), track_times=False)


def _write_column(file: h5py.File, name: str, rows: Sequence[ndarray]) -> None:
    column = COLUMNS[name]
    shapes = {row.shape for row in rows}
    if len(shapes) > 1:
        raise InputFileError(f"expected samples of one model in a shard, found {name} of shapes {sorted(shapes)}")
    shape = shapes.pop() if shapes else tuple(length or 0 for length in column.shape)
    values = np.stack(rows) if rows else np.zeros((0, *shape))
    file.create_dataset(name, data=values.astype(column.dtype), track_times=False)


def _write_images(file: h5py.File, images: Sequence[bytes]) -> None:
    content = np.frombuffer(b"".join(images), dtype=np.uint8)
    file.create_dataset("image_bytes", data=content, track_times=False)
    ends = np.cumsum([len(image) for image in images], dtype=np.int64)
    file.create_dataset("image_end", data=ends, dtype="<i8", track_times=False)


def _write_layers(
    file: h5py.File, names: Sequence[str], samples: Sequence[PackedTriplet], compression: Compression
) -> None:
    # Pictures of several sizes share one shape; what lies beyond a picture's own size compresses to nothing.
    height, width = (
        max([0, *lengths]) for lengths in zip(*(sample.size_px for sample in samples), (0, 0), strict=True)
    )
    datasets = {
        name: create_layer_dataset(file, LAYERS[name], (len(samples), height, width), compression) for name in names
    }
    for index, sample in enumerate(samples):
        for dataset in datasets.values():
            if dataset.size:
                _write_chunk(dataset, index, sample, compression)


def _write_chunk(dataset: h5py.Dataset, index: int, sample: PackedTriplet, compression: Compression) -> None:
    layer = LAYERS[dataset.name.lstrip("/")]
    packed, size_px, wanted_px = sample.chunks[layer.name], sample.size_px, dataset.shape[1:3]
    is_as_packed = compression.predicts(layer) == layer.is_smooth and size_px == wanted_px
    if not (is_as_packed and compression.is_deflate):
        box = layer_box(layer, sample.columns["box_px"], size_px)
        steps = unpack_layer(layer, packed, box, size_px, is_predicted=layer.is_smooth)
        packed = pack_layer(layer, steps, box, wanted_px, is_predicted=compression.predicts(layer))
    if compression.is_deflate:
        dataset.id.write_direct_chunk((index, *(0 for _ in dataset.shape[1:])), packed)
    else:
        picture = np.s_[0 : wanted_px[0]], np.s_[0 : wanted_px[1]]
        whole = unpack_layer(layer, packed, picture, wanted_px, is_predicted=False)
        dataset[index] = whole.view(dataset.dtype)


def _pack_layers(triplet: Triplet, names: Sequence[str]) -> tuple[dict[str, bytes], tuple[int, int], dict[str, Any]]:
    """Compresses the layers of a sample.

    Only the box of the mask is worked on: most of a picture is background.

    Returns:
        The compressed layers, their size in pixels, and what else is known of them then: the box, the largest offset,
        and the checksum of the layers.
    """
    for name in names:
        _check_shape(triplet, name, names)
    size_px = triplet.layers[names[0]].shape[:2] if names else (0, 0)
    mask = triplet.layers.get("mask")
    face = np.s_[0 : size_px[0]], np.s_[0 : size_px[1]]
    if mask is not None and names:
        face = face_box(mask.astype(bool, copy=False))
    box_px = np.array([face[0].start, face[1].start, face[0].stop, face[1].stop])
    chunks, checksum, largest = {}, 0, 0
    for name in names:
        layer = LAYERS[name]
        box = layer_box(layer, box_px, size_px)
        steps = to_stored(layer, triplet.layers[name][box])
        checksum = layer_checksum(layer, steps, box, size_px, checksum)
        chunks[name] = pack_layer(layer, steps, box, size_px, is_predicted=layer.is_smooth)
        if name == "offset":
            largest = max(int(steps.max(initial=0)), -int(steps.min(initial=0)))
    limit_mm = largest / LAYERS["offset"].steps_per_unit
    return chunks, size_px, {"box_px": box_px, "offset_limit_mm": np.array(limit_mm), "checksum": checksum}


def _check_shape(triplet: Triplet, name: str, names: Sequence[str]) -> None:
    if name not in triplet.layers:
        raise InputFileError(
            f"{triplet.sample_id}: expected the layer {name}, found {','.join(triplet.layers) or 'none'}"
        )
    found, first = triplet.layers[name].shape, triplet.layers[names[0]].shape
    if found != LAYERS[name].shape(*first[:2]):
        raise InputFileError(
            f"{triplet.sample_id}: expected {name} of shape {LAYERS[name].shape(*first[:2])}, found {found}"
        )


def _content_columns(triplet: Triplet, has_landmarks: bool) -> dict[str, Any]:
    kept = np.s_[:] if has_landmarks else np.s_[:0]
    values = {
        "camera": triplet.camera.matrix,
        "identity": triplet.identity,
        "expression": triplet.expression,
        "landmarks2d": triplet.landmarks2d[kept],
        "landmarks3d": triplet.landmarks3d[kept],
        "visible": triplet.visible[kept],
    }
    columns = {}
    for name, value in values.items():
        with np.errstate(over="ignore"):
            columns[name] = np.asarray(value).astype(CONTENT_COLUMNS[name].dtype)
        if not np.isfinite(columns[name]).all():
            raise InputFileError(f"{triplet.sample_id}: expected finite {name}, found others; are they sound?")
    return columns


def _image(triplet: Triplet) -> bytes:
    if not triplet.image:
        raise InputFileError(f"{triplet.sample_id}: expected a picture, since the shard is to have them; found none")
    return triplet.image


def _check_written(temporary: Path, content: bytes, path: Path) -> None:
    """Compares the file with what was to be written, and reads its first sample with the HDF5 library alone."""
    if temporary.read_bytes() != content:
        raise InputFileError(f"{path}: written, but does not read back the same; is the disk sound?")
    try:
        with h5py.File(temporary, "r") as file:
            for name in LAYERS:
                if name in file and file[name].size:
                    file[name][0]
    except (OSError, RuntimeError) as error:
        raise InputFileError(f"{path}: written, but the HDF5 library cannot read it ({error})") from error
