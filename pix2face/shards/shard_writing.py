"""Writing shards: samples are packed one by one, then written together, read back and renamed."""

import json
from collections.abc import Iterable, Sequence
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
from pix2face.shards.image_storage import IMAGE_LENGTH, pack_image, row_length
from pix2face.shards.layers import IMAGE, LANDMARKS, LAYERS, from_stored, to_stored
from pix2face.shards.map_storage import DEFLATE_LEVEL, Box, pack_layer, unpack_layer
from pix2face.shards.sample import MASK, Sample
from pix2face.shards.shard_layout import (
    CODED,
    COLUMNS,
    CONTENT_COLUMNS,
    FORMAT,
    PLAIN,
    PLAIN_VALUES,
    PREDICTED,
    SCHEMA_VERSION,
    TEXTS,
    ShardHeader,
    content_checksum,
    layer_boxes,
)

# HDF5's format of 2016, which lists chunks in the least space, and has attributes of any length.
HDF5_FORMAT = ("v110", "v110")
# Text has a fixed length for each shard: the longest of its samples decides, so one must not be without bounds.
LARGEST_TEXT_BYTES = {"sample_id": 4096, "attributes": 16384}


def write_shard(path: Path, header: ShardHeader, samples: Iterable[Sample], *, is_plain: bool = False) -> None:
    """Writes some samples as a shard: ``ShardWriter`` in one call."""
    writer = ShardWriter(header.layers, is_plain=is_plain)
    for sample in samples:
        writer.add(sample)
    writer.write(path, header)


@final
class ShardWriter:
    """Collects the samples of a shard, rounded and compressed, in a tenth of the memory, and writes them together.

    A plain shard stores smooth layers as plain numbers in their unit, which take about twice the space.
    """

    def __init__(self, layers: Sequence[str], *, is_plain: bool = False) -> None:
        self._is_plain = is_plain
        self._has_image, self._has_landmarks = IMAGE in layers, LANDMARKS in layers
        self._layers = [name for name in layers if name in LAYERS]
        self._texts: list[dict[str, bytes]] = []
        self._images: list[bytes] = []
        self._chunks: list[dict[str, bytes]] = []
        self._columns: list[dict[str, ndarray]] = []

    def add(self, sample: Sample) -> int:
        """Rounds and compresses one sample, and returns the checksum of its content.

        Where it has a mask, its layers are taken to be 0 outside the mask's bounding box (except layers of the whole
        head).

        Raises:
            InputFileError: The sample lacks a layer, or a value does not fit the format. The sample is left out.
        """
        if self._has_image and not sample.image_bytes:
            raise InputFileError(f"{sample.sample_id}: expected a picture, since the shard is to have them; found none")
        image = sample.image_bytes if self._has_image and sample.image_bytes else b""
        attributes = json.dumps(dict(sample.attributes), sort_keys=True, separators=(",", ":"))
        texts = {
            name: bounded_utf8(text, name, LARGEST_TEXT_BYTES[name])
            for name, text in (("sample_id", sample.sample_id), ("attributes", attributes))
        }
        steps, boxes, size_px, columns = _layers_in_steps(sample, self._layers)
        columns |= _content_columns(sample, self._has_landmarks)
        stored = {**steps, IMAGE: image, **columns, "attributes": texts["attributes"]}
        checksum = content_checksum(stored, boxes, size_px)
        columns["checksum"] = np.array(checksum)
        self._chunks.append({name: self._packed(name, steps[name], boxes[name], size_px) for name in steps})
        self._texts.append(texts)
        self._images.append(image)
        self._columns.append(columns)
        return checksum

    def write(self, path: Path, header: ShardHeader) -> None:
        """Writes a shard under a temporary name, reads it back, and renames it.

        The file is put together in memory and written in one go, so a full disk is an ordinary error; inside the HDF5
        library it is not. The header names the layers that the writer keeps.

        Raises:
            InputFileError: Ids are not unique, samples do not match, or what was written does not read back.
            UsageError: The file cannot be written, for instance since the disk is full.
        """
        content = self._file_content(header)
        try:
            # Two workers may be making the same shard.
            with written_in_one_step(path, is_contended=True) as temporary:
                temporary.write_bytes(content)
                _check_written(temporary, content, path)
        except OSError as error:
            raise UsageError(
                f"{path}: expected to write {len(content) / 1e6:.1f} MB, found that it cannot be ({error.strerror}); "
                "make room or choose another folder, and run the same command again: finished shards are kept"
            ) from error

    def _file_content(self, header: ShardHeader) -> bytes:
        ids = [texts["sample_id"] for texts in self._texts]
        if len(set(ids)) < len(ids):
            raise InputFileError("expected unique sample ids in a shard, found that sample ids are not unique")
        # Earlier formats of HDF5 have no attributes above 64 kB, which a header with many rejected samples exceeds.
        with h5py.File("shard", "w", driver="core", backing_store=False, track_order=False, libver=HDF5_FORMAT) as file:
            file.attrs["format"] = fixed_text(FORMAT)
            file.attrs["schema_version"] = SCHEMA_VERSION
            file.attrs["header"] = fixed_text(header.to_json())
            for name in TEXTS:
                _write_texts(file, name, [texts[name] for texts in self._texts])
            for name in COLUMNS:
                _write_column(file, name, [columns[name] for columns in self._columns])
            sizes = [tuple(columns["size_px"].tolist()) for columns in self._columns]
            # Pictures of several sizes share one shape; what is beyond a picture's own size compresses to nothing.
            padded_px = max((height for height, _ in sizes), default=0), max((width for _, width in sizes), default=0)
            if self._has_image:
                _write_images(file, self._images, padded_px)
            self._write_layers(file, sizes, padded_px)
            file.flush()
            return bytes(file.id.get_file_image())

    def _write_layers(self, file: h5py.File, sizes: Sequence[tuple[int, int]], padded_px: tuple[int, int]) -> None:
        """Writes one chunk a sample: random access decodes nothing but the sample asked for."""
        shape = (len(sizes), *padded_px)
        datasets = {name: _create_dataset(file, name, shape, is_plain=self._is_plain) for name in self._layers}
        corners = {name: (0,) * (dataset.ndim - 1) for name, dataset in datasets.items() if dataset.size}
        for index, (chunks, columns, size_px) in enumerate(zip(self._chunks, self._columns, sizes, strict=True)):
            boxes = layer_boxes(datasets, columns["box_px"], size_px)
            for name, corner in corners.items():
                chunk, box = chunks[name], boxes[name]
                if size_px != padded_px:
                    chunk = self._packed(name, self._unpacked(name, chunk, box, size_px), box, padded_px)
                datasets[name].id.write_direct_chunk((index, *corner), chunk)

    def _packed(self, name: str, steps: ndarray, box: Box, size_px: tuple[int, int]) -> bytes:
        layer = LAYERS[name]
        if self._is_plain and layer.is_smooth:
            return pack_layer(PLAIN_VALUES[name], from_stored(layer, steps), box, size_px, is_predicted=False)
        return pack_layer(layer, steps, box, size_px, is_predicted=layer.is_smooth)

    def _unpacked(self, name: str, chunk: bytes, box: Box, size_px: tuple[int, int]) -> ndarray:
        layer = LAYERS[name]
        if self._is_plain and layer.is_smooth:
            return to_stored(layer, unpack_layer(PLAIN_VALUES[name], chunk, box, size_px, is_predicted=False))
        return unpack_layer(layer, chunk, box, size_px, is_predicted=layer.is_smooth)


def _create_dataset(file: h5py.File, name: str, shape: tuple[int, int, int], *, is_plain: bool) -> h5py.Dataset:
    layer = LAYERS[name]
    is_coded = layer.is_smooth and not is_plain
    full = (shape[0], *layer.shape(*shape[1:]))
    dtype = np.dtype(f"<u{layer.stored.itemsize}") if is_coded else PLAIN_VALUES.get(name, layer).stored
    dataset = _create_chunked(file, f"{name}{CODED}" if is_coded else name, full, dtype)
    dataset.attrs["predictor"] = fixed_text(PREDICTED if is_coded else PLAIN)
    dataset.attrs["steps_per_unit"] = 1 if dtype.kind == "f" else layer.steps_per_unit
    return dataset


def _create_chunked(file: h5py.File, name: str, shape: tuple[int, ...], dtype: Any) -> h5py.Dataset:
    """A dataset whose rows are compressed chunks; an empty one has none."""
    options: dict[str, Any] = {}
    if all(shape):
        options = {"chunks": (1, *shape[1:]), "shuffle": np.dtype(dtype).itemsize > 1}
        options |= {"compression": "gzip", "compression_opts": DEFLATE_LEVEL}
    return file.create_dataset(name, shape, dtype=dtype, track_times=False, **options)


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


def _write_images(file: h5py.File, images: Sequence[bytes], padded_px: tuple[int, int]) -> None:
    n_bytes = row_length(images, padded_px)
    rows = _create_chunked(file, IMAGE, (len(images), n_bytes), np.dtype("u1"))
    for index, image in enumerate(images):
        rows.id.write_direct_chunk((index, 0), pack_image(image, n_bytes))
    file.create_dataset(IMAGE_LENGTH, data=np.array([*map(len, images)], dtype="<i4"), track_times=False)


def _layers_in_steps(
    sample: Sample, names: Sequence[str]
) -> tuple[dict[str, ndarray], dict[str, Box], tuple[int, int], dict[str, ndarray]]:
    """Rounds the layers of a sample. Only the box of the mask is worked on: most of a picture is background.

    Returns:
        The layers in steps, each in its box; these boxes; height and width; and the columns that follow from them.
    """
    for name in names:
        _check_shape(sample, name, names)
    size_px = sample.layers[names[0]].shape[:2] if names else (0, 0)
    mask = sample.layers.get(MASK)
    face = np.s_[0 : size_px[0]], np.s_[0 : size_px[1]]
    if mask is not None and names:
        face = face_box(mask.astype(bool, copy=False))
    box_px = np.array([face[0].start, face[1].start, face[0].stop, face[1].stop])
    boxes = layer_boxes(names, box_px, size_px)
    steps = {name: to_stored(LAYERS[name], sample.layers[name][box]) for name, box in boxes.items()}
    largest = 0
    if "offset" in steps:
        largest = max(int(steps["offset"].max(initial=0)), -int(steps["offset"].min(initial=0)))
    limit_mm = np.array(largest / LAYERS["offset"].steps_per_unit)
    return steps, boxes, size_px, {"box_px": box_px, "size_px": np.array(size_px), "offset_limit_mm": limit_mm}


def _check_shape(sample: Sample, name: str, names: Sequence[str]) -> None:
    if name not in sample.layers:
        raise InputFileError(
            f"{sample.sample_id}: expected the layer {name}, found {','.join(sample.layers) or 'none'}"
        )
    found, first = sample.layers[name].shape, sample.layers[names[0]].shape
    if found != LAYERS[name].shape(*first[:2]):
        raise InputFileError(
            f"{sample.sample_id}: expected {name} of shape {LAYERS[name].shape(*first[:2])}, found {found}"
        )


def _content_columns(sample: Sample, has_landmarks: bool) -> dict[str, Any]:
    kept = np.s_[:] if has_landmarks else np.s_[:0]
    values = {
        "camera": sample.camera.matrix,
        "identity": sample.identity,
        "expression": sample.expression,
        "landmarks2d": sample.landmarks2d[kept],
        "landmarks3d": sample.landmarks3d[kept],
        "visible": sample.visible[kept],
    }
    with np.errstate(over="ignore"):
        columns = {name: np.asarray(value).astype(CONTENT_COLUMNS[name].dtype) for name, value in values.items()}
    for name in columns:
        if not np.isfinite(columns[name]).all():
            raise InputFileError(f"{sample.sample_id}: expected finite {name}, found others; are they sound?")
    return columns


def _check_written(temporary: Path, content: bytes, path: Path) -> None:
    """Compares the file with what was to be written, and reads its first sample with the HDF5 library alone."""
    if temporary.read_bytes() != content:
        raise InputFileError(f"{path}: written, but does not read back the same; is the disk sound?")
    try:
        with h5py.File(temporary, "r", locking=False) as file:
            for item in file.values():
                if item.size:
                    item[0]
    except (OSError, RuntimeError) as error:
        raise InputFileError(f"{path}: written, but the HDF5 library cannot read it ({error})") from error
