"""Reading shards: each is one HDF5 file of samples (layout: docs/reference/file_formats.md).

The HDF5 library finds out once where everything stands in the file. Samples are then read from their places: to open a
file with HDF5 takes milliseconds and memory, and a training reads samples of thousands of shards in random order.
"""

import importlib
import math
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, final

import h5py
import numpy as np
from jaxtyping import Shaped
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.files.checked_hdf5 import filters_of, open_unchecked, read_version
from pix2face.files.text_columns import read_attributes
from pix2face.geometry.camera import Camera
from pix2face.shards.file_places import bytes_at, chunk_places, column_place, image_places
from pix2face.shards.image_storage import IMAGE_END, IMAGE_LENGTH, unpack_image
from pix2face.shards.layers import IMAGE, LANDMARKS, LAYERS, from_stored
from pix2face.shards.map_storage import Box, undo_prediction, unpack_layer
from pix2face.shards.sample import Sample
from pix2face.shards.shard_layout import (
    COLUMNS,
    CONTENT_COLUMNS,
    PLAIN_VALUES,
    SCHEMA_VERSION,
    TEXTS,
    ShardHeader,
    check_layout,
    content_checksum,
    is_predicted,
    layer_boxes,
    open_datasets,
    read_header,
)

__all__ = ["ShardHeader", "ShardReader", "shard_paths"]

# What reading a foreign, truncated or damaged file raises.
_DAMAGE = (OSError, KeyError, ValueError, RuntimeError, TypeError, IndexError)
PLUGIN_EXTRA = "pip install 'pix2face[storage]'"


@final
class ShardReader:
    """Reads the samples of one shard in any order.

    It keeps no file open: it can be pickled, may be used after a fork, and takes about 200 bytes for each sample.

    Raises:
        InputFileError: The file is missing, no shard, truncated, damaged, or of another schema.
        UsageError: It needs a filter of hdf5plugin, as shards of earlier versions may, and that is not installed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with _reading(path), open_unchecked(path, "a shard") as file:
            datasets = open_datasets(file, path)
            self.header = read_header(file, datasets, path)
            self.is_current = read_version(file.attrs, path) == SCHEMA_VERSION
            check_layout(datasets, self.header.layers)
            layers = {name: datasets[name] for name in self.header.layers if name in LAYERS}
            if not all(h5py.h5z.filter_avail(code) for dataset in layers.values() for code in filters_of(dataset)):
                _load_filters()
            self._columns = {name: column_place(datasets[name]) for name in (*COLUMNS, *TEXTS)}
            self._kept = {name: datasets[name][()] for name in ("size_px", "box_px", "checksum")}
            self._chunks = {name: chunk_places(dataset) for name, dataset in layers.items()}
            self._padded_px = {name: dataset.shape[1:3] for name, dataset in layers.items()}
            self._predicted = {name for name, dataset in layers.items() if is_predicted(dataset)}
            self._plain = {name for name, dataset in layers.items() if dataset.dtype.kind == "f"}
            self._names = {name: dataset.name for name, dataset in datasets.items()}
            if IMAGE in self.header.layers:
                self._images = image_places(datasets)
                self._image_ends = datasets[IMAGE_LENGTH if self.is_current else IMAGE_END][()]
                self._row_bytes = datasets[IMAGE].shape[1] if self.is_current else 0

    @property
    def is_plain(self) -> bool:
        """Whether no layer is coded: smooth layers are plain numbers."""
        return not self._predicted and bool(self._chunks.keys() & PLAIN_VALUES.keys())

    def __len__(self) -> int:
        return len(self._kept["checksum"])

    @property
    def sample_ids(self) -> list[str]:
        """The id of each sample."""
        with _reading(self.path):
            return [text.decode("utf-8") for text in self.column("sample_id").tolist()]

    def attributes(self) -> list[dict[str, str | float]]:
        """What else is known of each sample."""
        with _reading(self.path):
            return [read_attributes(text) for text in self.column("attributes").tolist()]

    def column(self, name: str) -> Shaped[ndarray, "n ..."]:
        """One of the small arrays that every sample has (``shard_layout.COLUMNS``), or a text as bytes."""
        column = self._columns[name]
        n_bytes = column.dtype.itemsize * int(np.prod(column.shape))
        with _reading(self.path):
            if column.start is None and n_bytes:
                return np.asarray(self._by_hdf5(name, ()))
            with self.path.open("rb", buffering=0) as file:
                content = bytes_at(file.fileno(), column.start or 0, n_bytes)
            return np.frombuffer(content, column.dtype).reshape(column.shape)

    def size_px(self, index: int) -> tuple[int, int]:
        """Height and width of a sample's layers; 0 where it has none."""
        height, width = self._kept["size_px"][index].tolist()
        return height, width

    def read(self, index: int, layers: Collection[str] | None = None) -> Sample:
        """Reads one sample, by its place in the shard from 0, with some layers (``image`` is the picture).

        None reads all layers that the shard has, an empty collection none: a hundred times as fast.

        Raises:
            UsageError: The shard lacks a layer.
            InputFileError: The sample is damaged.
        """
        wanted = [name for name in self.header.layers if layers is None or name in layers]
        for name in set(layers or ()) - set(wanted):
            raise UsageError(
                f"{self.path}: expected the layer {name}, found {','.join(self.header.layers)}; render with --layers"
            )
        names = [name for name in wanted if name != LANDMARKS]
        stored = self.stored(index, (*names, *CONTENT_COLUMNS, *TEXTS))
        try:
            return Sample(
                sample_id=stored["sample_id"].decode("utf-8"),
                image_bytes=stored.get(IMAGE),
                layers={name: self._whole(index, name, stored[name]) for name in names if name != IMAGE},
                camera=Camera(stored["camera"]),
                visible=stored["visible"].astype(bool),
                attributes=read_attributes(stored["attributes"]),
                place=f"{self.path}, sample {index}",
                **{name: stored[name] for name in ("identity", "expression", "landmarks2d", "landmarks3d")},
            )
        except _DAMAGE as error:
            raise self._damaged(index, error) from error

    def stored(
        self, index: int, names: Sequence[str], *, is_checked: bool = False, is_whole: bool = False
    ) -> dict[str, Any]:
        """Reads parts of a sample as they are stored: layers in steps, each in the box outside which it is 0.

        Args:
            index: Its place in the shard, from 0.
            names: Layers, ``image`` (the bytes of its file), columns, and texts (as bytes).
            is_checked: Compare the checksum. This reads all that there is of the sample; where most of it is wanted
                anyway, it takes a tenth longer.
            is_whole: Read layers whole, without relying on the box that the file states.

        Raises:
            IndexError: There is no such place.
            InputFileError: The sample is damaged.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"{self.path}: expected a place below {len(self)}, found {index}")
        try:
            size_px = self.size_px(index)
            box_px = np.array([0, 0, *size_px]) if is_whole else self._kept["box_px"][index]
            boxes = layer_boxes(self._chunks, box_px, size_px)
            images = [IMAGE] if IMAGE in self.header.layers else []
            content = (*boxes, *images, *CONTENT_COLUMNS, "attributes") if is_checked else ()
            file = os.open(self.path, os.O_RDONLY)
            try:
                wanted = dict.fromkeys((*content, *names))
                found = {name: self._part(file, index, name, boxes, is_whole) for name in wanted}
            finally:
                os.close(file)
            if is_checked and content_checksum(found, boxes, size_px) != self._kept["checksum"][index]:
                raise ValueError("the checksum differs: the content has changed since it was written")
        except _DAMAGE as error:
            raise self._damaged(index, error) from error
        return {name: found[name] for name in names}

    def _part(self, file: int, index: int, name: str, boxes: Mapping[str, Box], is_whole: bool) -> Any:
        """A layer in its box, the bytes of a picture or text, or the row of a column."""
        if name in boxes:
            return self._steps(file, index, name, boxes[name])
        if name == IMAGE:
            return self._image(file, index, is_whole)
        if name in self._kept:
            return self._kept[name][index]
        column = self._columns[name]
        n_bytes = column.dtype.itemsize * math.prod(column.shape[1:])
        if column.start is None:
            row = np.asarray(self._by_hdf5(name, index)) if n_bytes else np.zeros(column.shape[1:], column.dtype)
        else:
            # Of a copy, so that it can be written to.
            content = bytearray(bytes_at(file, column.start + index * n_bytes, n_bytes))
            row = np.frombuffer(content, column.dtype).reshape(column.shape[1:])
        return row.item() if name in TEXTS else row

    def _image(self, file: int, index: int, is_whole: bool) -> bytes:
        """The bytes of a picture; ``is_whole`` also checks what follows it in its row."""
        start, n_bytes = self._images[index].tolist()
        end = int(self._image_ends[index])
        if not self.is_current:  # pictures stand one after the other
            if n_bytes:
                return bytes_at(file, start, n_bytes)
            first = int(self._image_ends[index - 1]) if index else 0
            return bytes(self._by_hdf5("image_bytes", np.s_[first:end]).tobytes())
        if n_bytes:
            return unpack_image(bytes_at(file, start, n_bytes), end, self._row_bytes, is_whole=is_whole)
        return bytes(self._by_hdf5(IMAGE, np.s_[index, :end]).tobytes())

    def _steps(self, file: int, index: int, name: str, box: Box) -> Shaped[ndarray, "y x *c"]:
        start, length = self._chunks[name][index].tolist()
        layer, is_predicted = PLAIN_VALUES[name] if name in self._plain else LAYERS[name], name in self._predicted
        if length:
            packed = bytes_at(file, start, length)
            found = unpack_layer(layer, packed, box, self._padded_px[name], is_predicted=is_predicted)
        else:
            found = np.asarray(self._by_hdf5(name, (index, *box)))
            found = undo_prediction(found) if is_predicted else found
        if name not in self._plain:
            return found
        with np.errstate(invalid="ignore"):  # damaged values may be anything; their checksum will differ
            return np.rint(found * np.float32(layer.steps_per_unit)).astype(LAYERS[name].stored)

    def _by_hdf5(self, name: str, place: Any) -> Any:
        """Part of a dataset, read by the HDF5 library."""
        with open_unchecked(self.path) as file:
            return file[self._names[name]][place]

    def _whole(self, index: int, name: str, steps: Shaped[ndarray, "y x *c"]) -> Shaped[ndarray, "h w *c"]:
        """A layer of the whole picture, in its unit."""
        layer, size_px = LAYERS[name], self.size_px(index)
        whole = np.zeros(layer.shape(*size_px), dtype=layer.dtype)
        whole[layer_boxes([name], self._kept["box_px"][index], size_px)[name]] = from_stored(layer, steps)
        return whole

    def _damaged(self, index: int, error: Exception) -> InputFileError:
        """The error that names a damaged sample."""
        try:
            name = f"sample {self.sample_ids[index]!r}"
        except (InputFileError, IndexError):
            name = f"sample number {index}"
        return InputFileError(
            f"{self.path}: {name} is damaged ({error}); `datagen verify {self.path.parent}` lists all damage: "
            "delete the shards that it names and run `datagen render` again, it writes what is missing"
        )


def _load_filters() -> None:
    """Makes the filters of hdf5plugin known to the HDF5 library.

    Raises:
        UsageError: It is not installed.
    """
    try:
        importlib.import_module("hdf5plugin")
    except ImportError as error:
        raise UsageError(
            f"expected hdf5plugin for this compression, found that it is not installed; {PLUGIN_EXTRA}"
        ) from error


def shard_paths(folder: Path) -> list[Path]:
    """The shards of a folder, sorted.

    Raises:
        UsageError: There is no such folder or no shard in it.
    """
    if folder.is_file():
        raise UsageError(f"{folder}: expected a folder of shards (shard-*.h5), found a file")
    paths = sorted(folder.glob("shard-*.h5"))
    if not paths:
        found = "no shard-*.h5 in it" if folder.is_dir() else "no such folder"
        raise UsageError(
            f"{folder}: expected a folder of shards, found {found}; `datagen render --out {folder}` makes one"
        )
    return paths


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turns what h5py raises on a missing, foreign or truncated file into one error of ours."""
    try:
        yield
    except _DAMAGE as error:
        raise InputFileError(
            f"{path}: expected a complete shard, found one that cannot be read ({error}); "
            "delete it and run `datagen render` again: it writes what is missing"
        ) from error
