"""Where the bytes of each sample stand in a shard's file, so that a trainer reads them without the HDF5 library.

Opening a shard takes some milliseconds and holds memory as long as it is open; a training set has thousands of shards
and takes samples from them in random order. The places of all samples take 200 bytes each, are found once, and then a
sample is a few reads from a file descriptor. Only for layers in HDF5's shuffle and deflate, which is the default.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import h5py
import numpy as np
from jaxtyping import Float32, Int32, Int64, Shaped, UInt32
from numpy import ndarray

from pix2face.shards.compressions import is_shuffle_deflate
from pix2face.shards.layers import LAYERS
from pix2face.shards.map_storage import Box, unpack_layer
from pix2face.shards.shard_layout import (
    CONTENT_COLUMNS,
    content_checksum,
    is_predicted,
    layer_box,
    layer_checksum,
)
from pix2face.shards.shard_reader import ShardReader

# Reads bytes of a shard's file: from where on, and how many.
ReadBytes = Callable[[int, int], bytes]


@final
@dataclass(frozen=True, eq=False)
class StoredSample:
    """A sample as it was read.

    Attributes:
        image: Content of a picture's file; empty where the set has none.
        steps: Layers in steps, each where it is not 0.
        corner: Column and row of the mask's bounding box.
        landmarks2d: px; none where the set has none.
    """

    image: bytes
    steps: Mapping[str, ndarray]
    corner: tuple[int, int]
    landmarks2d: Float32[ndarray, "m 2"]


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class ShardSpans:
    """The places of a shard's samples in its file, in bytes from its start.

    Attributes:
        path: The file.
        layers: Names, in the order of the checksum.
        predicted: Those that are stored as what the predictor leaves.
        layers_px: Height and width of what is stored of each; a sample's own layers may be smaller.
        chunks: Start and length of each sample's layers.
        images: Start and length of the pictures; of length 0 where there are none.
        columns: Start of a column, and bytes of one of its rows: of ``CONTENT_COLUMNS``, and of the attributes.
        box_px: Top, left, bottom, right of the masks.
        size_px: Height and width of the samples.
        checksums: As stored.
    """

    path: Path
    layers: tuple[str, ...]
    predicted: frozenset[str]
    layers_px: tuple[int, int]
    chunks: Int64[ndarray, "n l 2"]
    images: Int64[ndarray, "n 2"]
    columns: Mapping[str, tuple[int, int]]
    box_px: Int32[ndarray, "n 4"]
    size_px: Int32[ndarray, "n 2"]
    checksums: UInt32[ndarray, " n"]

    def box(self, index: int, layer: str) -> Box:
        """Where a sample's layer is not 0."""
        height, width = self.size_px[index].tolist()
        return layer_box(LAYERS[layer], self.box_px[index], (height, width))

    def sample(self, index: int, layers: Sequence[str], read: ReadBytes, *, is_checked: bool) -> StoredSample:
        """Picture and layers of a sample.

        Args:
            index: Which sample.
            layers: What is wanted of it.
            read: Reads from the file.
            is_checked: Compare its checksum. This reads all that there is of it; where that is wanted anyway, it takes
                a tenth longer.

        Raises:
            ValueError: It is damaged.
        """
        steps = {name: self._steps(index, name, read) for name in (self.layers if is_checked else layers)}
        start, length = self.images[index].tolist()
        image = read(start, length)
        if is_checked and self._checksum(index, steps, image, read) != int(self.checksums[index]):
            raise ValueError("the checksum differs: the content has changed since it was written")
        top, left = self.box_px[index, :2].tolist()
        landmarks2d = np.frombuffer(self._row(index, "landmarks2d", read), dtype=CONTENT_COLUMNS["landmarks2d"].dtype)
        return StoredSample(image, {name: steps[name] for name in layers}, (left, top), landmarks2d.reshape(-1, 2))

    def _row(self, index: int, column: str, read: ReadBytes) -> bytes:
        start, length = self.columns[column]
        return read(start + index * length, length)

    def _steps(self, index: int, name: str, read: ReadBytes) -> Shaped[ndarray, "y x *c"]:
        start, length = self.chunks[index, self.layers.index(name)].tolist()
        packed, box, is_predicted = read(start, length), self.box(index, name), name in self.predicted
        return unpack_layer(LAYERS[name], packed, box, self.layers_px, is_predicted=is_predicted)

    def _checksum(self, index: int, steps: Mapping[str, ndarray], image: bytes, read: ReadBytes) -> int:
        height, width = self.size_px[index].tolist()
        found = 0
        for name in self.layers:
            found = layer_checksum(LAYERS[name], steps[name], self.box(index, name), (height, width), found)
        columns = {
            name: np.frombuffer(self._row(index, name, read), dtype=column.dtype)
            for name, column in CONTENT_COLUMNS.items()
        }
        return content_checksum(found, image, columns, self._row(index, "attributes", read).rstrip(b"\0"))


def find_spans(reader: ShardReader) -> ShardSpans | None:
    """The places of an open shard's samples; None where only the HDF5 library finds or decodes them."""
    datasets = reader.datasets
    layers = tuple(name for name in reader.header.layers if name in LAYERS)
    columns = {name: _column_span(datasets[name]) for name in (*CONTENT_COLUMNS, "attributes")}
    chunks = [_chunk_spans(datasets[name]) for name in layers]
    images = _image_spans(datasets, len(reader))
    known_columns = {name: span for name, span in columns.items() if span is not None}
    known_chunks = [spans for spans in chunks if spans is not None]
    if images is None or not chunks or len(known_columns) < len(columns) or len(known_chunks) < len(chunks):
        return None
    return ShardSpans(
        path=reader.path,
        layers=layers,
        predicted=frozenset(name for name in layers if is_predicted(datasets[name])),
        layers_px=datasets[layers[0]].shape[1:3],
        chunks=np.stack(known_chunks, axis=1),
        images=images,
        columns=known_columns,
        box_px=datasets["box_px"][()],
        size_px=datasets["size_px"][()],
        checksums=datasets["checksum"][()],
    )


def _column_span(dataset: h5py.Dataset) -> tuple[int, int] | None:
    """Start of a column and bytes of a row; None where its rows are not one after the other in the file."""
    row_bytes = dataset.dtype.itemsize * int(np.prod(dataset.shape[1:], dtype=np.int64))
    start = dataset.id.get_offset() if dataset.chunks is None else None
    if not row_bytes:
        return 0, 0
    return None if start is None else (start, row_bytes)


def _image_spans(datasets: Mapping[str, h5py.Dataset], n: int) -> Int64[ndarray, "n 2"] | None:
    """Start and length of each picture; None where they are not one after the other in the file."""
    if "image_bytes" not in datasets:
        return np.zeros((n, 2), dtype=np.int64)
    start = datasets["image_bytes"].id.get_offset() if datasets["image_bytes"].chunks is None else None
    if start is None:
        return None
    ends = datasets["image_end"][()]
    starts = np.concatenate([[0], ends[:-1]])
    return np.stack([starts + start, ends - starts], axis=1)


def _chunk_spans(dataset: h5py.Dataset) -> Int64[ndarray, "n 2"] | None:
    """Start and length of each sample's chunk; None where one is missing or not shuffled and deflated."""
    spans = np.zeros((len(dataset), 2), dtype=np.int64)
    if not is_shuffle_deflate(dataset):
        return None

    def note(chunk: h5py.h5d.StoreInfo) -> None:
        if not chunk.filter_mask:  # HDF5 leaves out a filter where it does not shrink a chunk
            spans[chunk.chunk_offset[0]] = chunk.byte_offset, chunk.size

    dataset.id.chunk_iter(note)
    return spans if spans[:, 1].all() else None
