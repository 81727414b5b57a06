"""How the layers of a sample become bytes in a shard, and back.

A sample's layer is one HDF5 chunk. The default is HDF5's own pair of filters, shuffle and deflate, which every HDF5
library reads; the bytes are made and unmade here, because ISA-L does that several times as fast as the zlib inside
HDF5 (docs/storage.md has the figures).
"""

from collections.abc import Sequence
from typing import Any

import h5py
import numpy as np
from isal import isal_zlib
from jaxtyping import Shaped, UInt8
from numpy import ndarray

# ISA-L's levels are 0 to 3; the level written to the file is advice to HDF5, should it ever compress a chunk itself.
DEFLATE_LEVEL = 1
# Deflate never shrinks more than this; what claims to is no deflate stream.
LARGEST_DEFLATE_RATIO = 1032


def pack_chunk(stored: Shaped[ndarray, "*shape"]) -> bytes:
    """A layer as HDF5's shuffle and deflate filters would store it."""
    return bytes(isal_zlib.compress(shuffled(stored), DEFLATE_LEVEL))


def unpack_chunk(packed: bytes, dtype: Any, shape: Sequence[int]) -> Shaped[ndarray, "*shape"]:
    """What ``pack_chunk`` packed. Never makes more bytes than the shape has, nor more than ``packed`` can hold.

    Raises:
        ValueError: The bytes are no such stream, or of another length.
    """
    n_bytes = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    if n_bytes > LARGEST_DEFLATE_RATIO * (len(packed) + 1):
        raise ValueError(f"expected a layer of {n_bytes} bytes, found {len(packed)} compressed ones: too few")
    try:
        stream = isal_zlib.decompressobj()
        raw = stream.decompress(packed, n_bytes + 1)
    except isal_zlib.error as error:  # type: ignore[misc] # the stub says it is a value
        raise ValueError(f"expected a compressed layer, found damaged bytes ({error})") from error
    if len(raw) != n_bytes or not stream.eof:
        raise ValueError(f"expected a layer of {n_bytes} bytes, found {len(raw)}")
    return unshuffled(raw, dtype, shape)


def shuffled(values: Shaped[ndarray, "*shape"]) -> UInt8[ndarray, " n"]:
    """HDF5's shuffle filter: all first bytes, all second bytes, and so on."""
    columns = np.ascontiguousarray(values).reshape(-1).view(np.uint8).reshape(values.size, values.itemsize)
    return np.ascontiguousarray(columns.T).reshape(-1)


def unshuffled(raw: bytes, dtype: Any, shape: Sequence[int]) -> Shaped[ndarray, "*shape"]:
    """Undoes ``shuffled``."""
    rows = np.frombuffer(raw, dtype=np.uint8).reshape(np.dtype(dtype).itemsize, -1)
    return np.ascontiguousarray(rows.T).reshape(-1).view(dtype).reshape(tuple(shape))


def create_layer_dataset(file: h5py.File, name: str, shape: Sequence[int], dtype: Any) -> h5py.Dataset:
    """An empty dataset with one chunk a sample, to be filled with ``pack_chunk``'s bytes.

    Args:
        file: Where to.
        name: Of the layer.
        shape: Samples first.
        dtype: As stored.
    """
    options: dict[str, Any] = {}
    if all(shape):
        options = {
            "chunks": (1, *shape[1:]),
            "compression": "gzip",
            "compression_opts": DEFLATE_LEVEL,
            "shuffle": np.dtype(dtype).itemsize > 1,
        }
    return file.create_dataset(name, tuple(shape), dtype=dtype, track_times=False, **options)


def is_shuffle_deflate(dataset: h5py.Dataset) -> bool:
    """Whether the chunks of a dataset are what ``pack_chunk`` makes."""
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(index)[0] for index in range(properties.get_nfilters())]
    shuffle = [h5py.h5z.FILTER_SHUFFLE] if dataset.dtype.itemsize > 1 else []
    return filters == [*shuffle, h5py.h5z.FILTER_DEFLATE]
