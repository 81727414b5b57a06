"""The shard: one HDF5 file of triplets (layout: docs/reference/file_formats.md).

Reading needs only HDF5's built-in filters. A shard appears under its name when it is complete and read back; until
then it has a temporary name, so an interrupted job leaves no half shard.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import final

import h5py
import numpy as np
from isal.isal_zlib import crc32
from jaxtyping import Float32, Shaped, UInt8
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.files.images import declared_size_px, decode_image
from pix2face.files.text_columns import read_attributes
from pix2face.geometry.camera import Camera
from pix2face.geometry.maps import FaceCut, FaceMaps
from pix2face.shards.compressions import is_shuffle_deflate, load_filters, needs_plugin
from pix2face.shards.layers import DEFAULT_LAYERS, IMAGE, LAYERS, from_stored
from pix2face.shards.map_storage import Box, undo_prediction, unpack_layer
from pix2face.shards.shard_layout import (
    CONTENT_COLUMNS,
    check_layout,
    content_checksum,
    is_predicted,
    layer_box,
    open_datasets,
    read_header_fields,
)
from pix2face.shards.triplet import MAP_LAYERS, Triplet, check_has_layers

__all__ = ["ShardHeader", "ShardReader", "Triplet", "shard_paths"]


@final
@dataclass(frozen=True, kw_only=True)
class ShardHeader:
    """What holds for every sample of a shard.

    Attributes:
        model_name: The morphable model that the maps refer to.
        model_sha256: Its hash.
        pncc_limit_mm: Largest coordinate of the mean face: PNCC divided by it stays within ±1.
        smallest_radius_mm: Distance from the origin to the nearest point of the mean face.
        licence: Terms of the pictures and of the model.
        configuration: The resolved configuration of the job, as JSON.
        generator: Program and version.
        rejected: The samples of this unit of work that could not be used, as JSON: id and reason of each.
        layers: What each sample has, of ``pix2face.shards.layers.LAYER_NAMES``.
        region_names: Of the model: what the layer ``regions`` counts.
        mirror_obstacle: Why samples cannot be mirrored; empty where they can (``mirroring.mirror_obstacle``).
    """

    model_name: str
    model_sha256: str
    pncc_limit_mm: float
    smallest_radius_mm: float
    licence: str
    configuration: str
    generator: str
    rejected: str = "[]"
    layers: tuple[str, ...] = DEFAULT_LAYERS
    region_names: tuple[str, ...] = ()
    mirror_obstacle: str = "nobody said whether the model is symmetric"


@final
class ShardReader:
    """Reads one shard; a sample at a time, nothing of its pictures and layers kept.

    Raises:
        InputFileError: The file is missing, no shard, truncated, damaged, or of another schema.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with _reading(path):
            self._file = h5py.File(path, "r")
        try:
            with _reading(path):
                self._datasets = open_datasets(self._file, path)
                self._columns: dict[str, ndarray] = {}
                self.header = ShardHeader(**read_header_fields(self._datasets, path))
                check_layout(self._datasets, self.header.layers)
                self._layers = {name: self._datasets[name] for name in self.header.layers if name in LAYERS}
                self.sample_ids: list[str] = [text.decode("utf-8") for text in self._datasets["sample_id"][()].tolist()]
                self.offset_limits_mm: Float32[ndarray, " n"] = self._column("offset_limit_mm")
                self._is_predicted = {name: is_predicted(dataset) for name, dataset in self._layers.items()}
                self._is_deflate = {name: is_shuffle_deflate(dataset) for name, dataset in self._layers.items()}
                if any(needs_plugin(dataset) for dataset in self._layers.values()):
                    load_filters()
        except BaseException:
            self._file.close()
            raise

    def __len__(self) -> int:
        return len(self.sample_ids)

    def __enter__(self) -> "ShardReader":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file; reading afterwards fails."""
        self._file.close()

    @property
    def datasets(self) -> Mapping[str, h5py.Dataset]:
        """What the file holds, checked for its layout; of use until the file is closed."""
        return self._datasets

    def image_bytes(self, index: int) -> bytes:
        """The encoded picture of a sample.

        Raises:
            UsageError: The shard has none.
        """
        if IMAGE not in self.header.layers:
            raise UsageError(f"{self.path}: expected pictures, found layers {','.join(self.header.layers)}")
        with _reading(self.path):
            ends = self._column("image_end")
            start = int(ends[index - 1]) if index else 0
            return bytes(self._datasets["image_bytes"][start : int(ends[index])].tobytes())

    def image(self, index: int) -> UInt8[ndarray, "h w 3"]:
        """The picture of a sample, RGB; of the size of its layers, if it has any.

        Raises:
            UsageError: The shard has none.
            InputFileError: It cannot be decoded, or is of another size.
        """
        content, where = self.image_bytes(index), f"{self.path}, sample {index}"
        size_px, declared = self.size_px(index), declared_size_px(content, where)
        if declared not in (None, size_px) and size_px != (0, 0):
            raise InputFileError(f"{where}: expected a picture like its layers, {size_px}, found one of {declared}")
        return decode_image(content, where)

    def layer(self, index: int, name: str) -> Shaped[ndarray, "h w *c"]:
        """A layer of a sample in its unit.

        Raises:
            UsageError: The shard has no such layer.
            InputFileError: What is stored is damaged.
        """
        steps, box = self._box_steps(index, name)
        whole = np.zeros(LAYERS[name].shape(*self.size_px(index)), dtype=LAYERS[name].dtype)
        whole[box] = from_stored(LAYERS[name], steps)
        return whole

    def stored_layer(self, index: int, name: str) -> Shaped[ndarray, "h w *c"]:
        """A layer in steps (the layer's stored dtype), read without trust in where it says that it is 0."""
        height, width = self.size_px(index)
        return self._steps(index, name, (slice(0, height), slice(0, width)))

    def size_px(self, index: int) -> tuple[int, int]:
        """Height and width of a sample's layers; 0 where it has none."""
        with _reading(self.path):
            height, width = self._column("size_px")[index].tolist()
        return height, width

    def box_px(self, index: int) -> tuple[int, int, int, int]:
        """Top, left, bottom and right of the mask's bounding box; the ends are the first row and column beyond."""
        with _reading(self.path):
            top, left, bottom, right = self._column("box_px")[index].tolist()
        return top, left, bottom, right

    def maps(self, index: int) -> FaceMaps:
        """PNCC, offset and mask of a sample, mm.

        Raises:
            UsageError: The shard has not all of them.
        """
        check_has_layers(self._layers, MAP_LAYERS, str(self.path))
        return FaceMaps(*(self.layer(index, name) for name in MAP_LAYERS))

    def face_cut(self, index: int) -> FaceCut:
        """PNCC, offset and mask of a sample in steps, cut to the mask's bounding box: what a trainer keeps.

        Raises:
            UsageError: The shard has not all of them.
        """
        check_has_layers(self._layers, MAP_LAYERS, str(self.path))
        (pncc, box), (offset, _), (mask, _) = (self._box_steps(index, name) for name in MAP_LAYERS)
        return FaceCut(pncc, offset, mask.astype(bool), (int(box[1].start), int(box[0].start)))

    def landmarks2d(self, index: int) -> Float32[ndarray, "m 2"]:
        """The landmarks of a sample, px."""
        with _reading(self.path):
            return self._column("landmarks2d")[index]

    def attributes(self) -> list[dict[str, str | float]]:
        """What else is known of each sample."""
        with _reading(self.path):
            return [read_attributes(text) for text in self._datasets["attributes"][()].tolist()]

    def stored_checksums(self) -> list[str]:
        """The checksum that was stored with each sample, in hexadecimal digits; nothing is recomputed."""
        with _reading(self.path):
            return [f"{value:08x}" for value in self._column("checksum").tolist()]

    def checksum_pair(self, index: int) -> tuple[int, int]:
        """The checksum that was stored with a sample, and that of what is there now."""
        image = self.image_bytes(index) if IMAGE in self.header.layers else b""
        found = 0
        for name in self._layers:
            found = crc32(np.ascontiguousarray(self.stored_layer(index, name)), found)
        with _reading(self.path):
            columns = {name: self._column(name)[index] for name in CONTENT_COLUMNS}
            found = content_checksum(found, image, columns, bytes(self._datasets["attributes"][index]))
            return int(self._column("checksum")[index]), found

    def triplet(self, index: int, with_pixels: bool = True) -> Triplet:
        """Everything that is known of a sample; without its pixels (picture, layers) a hundred times as fast."""
        with _reading(self.path):
            attributes = read_attributes(bytes(self._datasets["attributes"][index]))
            return Triplet(
                sample_id=self.sample_ids[index],
                image=self.image_bytes(index) if with_pixels and IMAGE in self.header.layers else None,
                layers={name: self.layer(index, name) for name in self._layers if with_pixels},
                camera=Camera(self._column("camera")[index]),
                attributes=attributes,
                visible=self._column("visible")[index].astype(bool),
                **{
                    name: self._column(name)[index] for name in ("identity", "expression", "landmarks2d", "landmarks3d")
                },
            )

    def _box_steps(self, index: int, name: str) -> tuple[Shaped[ndarray, "y x *c"], Box]:
        """A layer in steps where it is not 0, and where that is."""
        with _reading(self.path):
            box = layer_box(LAYERS[name], self._column("box_px")[index], self.size_px(index))
        return self._steps(index, name, box), box

    def _steps(self, index: int, name: str, box: Box) -> Shaped[ndarray, "y x *c"]:
        """A layer in steps in a box before which there is nothing but 0."""
        if name not in self._layers:
            raise UsageError(
                f"{self.path}: expected the layer {name}, found {','.join(self.header.layers)}; render with --layers"
            )
        with _reading(self.path):
            dataset, layer = self._layers[name], LAYERS[name]
            if self._is_deflate[name]:
                left_out, chunk = dataset.id.read_direct_chunk((index, *(0 for _ in dataset.shape[1:])))
                if not left_out:  # HDF5 leaves out a filter where it does not shrink a chunk
                    size_px = dataset.shape[1:3]
                    return unpack_layer(layer, chunk, box, size_px, is_predicted=self._is_predicted[name])
            found = np.asarray(dataset[(index, *box)])
            return undo_prediction(found) if self._is_predicted[name] else found

    def _column(self, name: str) -> ndarray:
        if name not in self._columns:
            self._columns[name] = self._datasets[name][()]
        return self._columns[name]


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
    except FileNotFoundError as error:
        raise InputFileError(f"{path}: no such shard") from error
    except (OSError, KeyError, ValueError, RuntimeError, TypeError, IndexError, UnicodeDecodeError) as error:
        raise InputFileError(
            f"{path}: expected a complete shard, found one that cannot be read ({error}); "
            "delete it and run `datagen render` again: it writes what is missing"
        ) from error
