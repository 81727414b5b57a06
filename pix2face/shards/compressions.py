"""What a shard's layers may be compressed with: the default, and what some users would rather have."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, final

import h5py
import numpy as np

from pix2face.errors import UsageError
from pix2face.files.checked_hdf5 import fixed_text
from pix2face.shards.layers import Layer
from pix2face.shards.map_storage import DEFLATE_LEVEL

PLUGIN_EXTRA = "pip install 'pix2face[storage]'"
# HDF5 keeps the numbers up to this for its own filters.
LARGEST_OWN_FILTER = 255
PREDICTED, PLAIN = "planar", "none"


@final
@dataclass(frozen=True, kw_only=True)
class Compression:
    """One way to store layers.

    Attributes:
        name: As chosen on a command line.
        is_predicted: Smooth layers are stored as what a planar predictor leaves.
        is_deflate: HDF5's shuffle and deflate, which are made and unmade outside the HDF5 library.
        plugin: Class of hdf5plugin that gives the filter's options, where it is none of HDF5's own.
        options: Of that class.
        meaning: In a sentence.
    """

    name: str
    is_predicted: bool
    is_deflate: bool
    plugin: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    meaning: str

    def predicts(self, layer: Layer) -> bool:
        """Whether a layer is stored as what the predictor leaves."""
        return self.is_predicted and layer.is_smooth

    def dtype(self, layer: Layer) -> Any:
        """Of the layer's dataset: what the predictor leaves is unsigned."""
        return np.dtype(f"<u{layer.stored.itemsize}") if self.predicts(layer) else layer.stored


_TABLE = (
    Compression(
        name="deflate",
        is_predicted=True,
        is_deflate=True,
        meaning="small, fast, read by every HDF5 library; two lines turn what it reads into values",
    ),
    Compression(
        name="plain",
        is_predicted=False,
        is_deflate=True,
        meaning="values as they are, read by every HDF5 library; nearly twice as large",
    ),
    Compression(
        name="zstd",
        is_predicted=True,
        is_deflate=False,
        plugin="Zstd",
        options={"clevel": 3},
        meaning="up to a tenth smaller, faster to read, slower to write; needs hdf5plugin wherever it is read",
    ),
)
COMPRESSIONS: Mapping[str, Compression] = {compression.name: compression for compression in _TABLE}
DEFAULT_COMPRESSION = "deflate"


def find_compression(name: str) -> Compression:
    """The compression of this name, its filter at hand.

    Raises:
        UsageError: There is none, or its filter is not installed.
    """
    if name not in COMPRESSIONS:
        raise UsageError(f"expected a compression among {', '.join(COMPRESSIONS)}, found {name!r}")
    if COMPRESSIONS[name].plugin:
        load_filters()
    return COMPRESSIONS[name]


def load_filters() -> Any:
    """Makes the filters of hdf5plugin known to the HDF5 library.

    Raises:
        UsageError: It is not installed.
    """
    try:
        return importlib.import_module("hdf5plugin")
    except ImportError as error:
        raise UsageError(
            f"expected hdf5plugin for this compression, found that it is not installed; {PLUGIN_EXTRA}"
        ) from error


def create_layer_dataset(
    file: h5py.File, layer: Layer, shape: tuple[int, int, int], compression: Compression
) -> h5py.Dataset:
    """An empty dataset with one chunk a sample: random access decodes nothing but the sample asked for.

    Args:
        file: Where to.
        layer: Which one.
        shape: Samples, height, width.
        compression: How.
    """
    full = (shape[0], *layer.shape(*shape[1:]))
    dtype = compression.dtype(layer)
    options: dict[str, Any] = {}
    if all(full):
        options = {"chunks": (1, *full[1:]), "shuffle": dtype.itemsize > 1}
        if compression.is_deflate:
            options |= {"compression": "gzip", "compression_opts": DEFLATE_LEVEL}
        else:
            options |= getattr(load_filters(), compression.plugin)(**compression.options)
    dataset = file.create_dataset(layer.name, full, dtype=dtype, track_times=False, **options)
    dataset.attrs["predictor"] = fixed_text(PREDICTED if compression.predicts(layer) else PLAIN)
    dataset.attrs["steps_per_unit"] = layer.steps_per_unit
    return dataset


def is_shuffle_deflate(dataset: h5py.Dataset) -> bool:
    """Whether the chunks of a dataset are as ``map_storage.pack_layer`` makes them."""
    shuffle = [h5py.h5z.FILTER_SHUFFLE] if dataset.dtype.itemsize > 1 else []
    return _filters(dataset) == [*shuffle, h5py.h5z.FILTER_DEFLATE]


def needs_plugin(dataset: h5py.Dataset) -> bool:
    """Whether a filter of a dataset is none that the HDF5 library has at the moment."""
    return not all(h5py.h5z.filter_avail(code) for code in _filters(dataset))


def has_foreign_filter(dataset: h5py.Dataset) -> bool:
    """Whether a filter of a dataset is none of HDF5's own, at hand or not."""
    return any(code > LARGEST_OWN_FILTER for code in _filters(dataset))


def _filters(dataset: h5py.Dataset) -> list[int]:
    properties = dataset.id.get_create_plist()
    return [properties.get_filter(index)[0] for index in range(properties.get_nfilters())]
