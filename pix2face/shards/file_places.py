"""Where the parts of the samples stand in the file of a shard, so that they can be read without the HDF5 library."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import h5py
import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from pix2face.files.checked_hdf5 import filters_of
from pix2face.shards.image_storage import IMAGE_END
from pix2face.shards.layers import IMAGE


@final
@dataclass(frozen=True)
class ColumnPlace:
    """A dataset that has one row for each sample; ``start`` in the file is None where the rows are not contiguous."""

    start: int | None
    dtype: Any
    shape: tuple[int, ...]


def column_place(dataset: h5py.Dataset) -> ColumnPlace:
    """The place of a dataset of small rows."""
    start = dataset.id.get_offset() if dataset.chunks is None else None
    return ColumnPlace(start, dataset.dtype, dataset.shape)


def chunk_places(dataset: h5py.Dataset) -> Int64[ndarray, "n 2"]:
    """Start and length in the file of each sample's chunk; length 0 where only the HDF5 library decodes it."""
    places = np.zeros((len(dataset), 2), dtype=np.int64)
    shuffle = [h5py.h5z.FILTER_SHUFFLE] if dataset.dtype.itemsize > 1 else []
    if filters_of(dataset) == [*shuffle, h5py.h5z.FILTER_DEFLATE]:  # as `map_storage.pack_layer` stores it

        def note(chunk: h5py.h5d.StoreInfo) -> None:
            if not chunk.filter_mask:  # HDF5 leaves out a filter where it does not shrink a chunk
                places[chunk.chunk_offset[0]] = chunk.byte_offset, chunk.size

        dataset.id.chunk_iter(note)
    return places


def image_places(datasets: Mapping[str, h5py.Dataset]) -> Int64[ndarray, "n 2"]:
    """Start and length in the file of each picture, packed or, in schema 2, as it is; length 0 as in `chunk_places`."""
    if IMAGE in datasets:
        return chunk_places(datasets[IMAGE])
    start, ends = column_place(datasets["image_bytes"]).start, datasets[IMAGE_END][()]
    lengths = np.diff(ends, prepend=0)
    return np.stack([ends - lengths + (start or 0), lengths if start is not None else 0 * lengths], axis=1)


def bytes_at(file: int, start: int, length: int) -> bytes:
    """Reads a part of an open file.

    Raises:
        ValueError: The file is shorter.
    """
    content = os.pread(file, length, start)
    if len(content) < length:
        raise ValueError(f"expected {length} bytes at {start}, found {len(content)}")
    return content
