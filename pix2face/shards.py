"""The shard: one HDF5 file of triplets (layout: docs/file_formats.md).

Reading needs only HDF5's built-in filters. A shard appears under its name when it is complete and read back; until
then it has a temporary name, so an interrupted job leaves no half shard.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, final

import h5py
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from numpy import ndarray

from pix2face.camera import Camera
from pix2face.errors import InputFileError, UsageError
from pix2face.face_maps import FaceMaps, fixed_point_to_maps
from pix2face.images import decode_image

FORMAT = "pix2face-shard"
SCHEMA_VERSION = 1
DEPTH_STEPS_PER_MM = 128


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Triplet:
    """One sample: a picture, its maps, and what they were made from.

    Attributes:
        sample_id: Unique in its set of shards.
        image: Content of a JPEG or PNG file: a photograph's own bytes where it was not resampled.
        maps: Ground truth.
        depth: mm, larger is farther; 0 outside the mask.
        camera: Sees the model in this picture.
        identity: Standard deviations.
        expression: Standard deviations.
        landmarks2d: Pixels.
        landmarks3d: mm, model frame.
        visible: Which landmarks are inside the picture and not hidden by the head itself.
        attributes: What else is known of the sample (pose in degrees, where geometry and picture come from), to filter
            on.
    """

    sample_id: str
    image: bytes
    maps: FaceMaps
    depth: Float32[ndarray, "h w"]
    camera: Camera
    identity: Float[ndarray, " k"]
    expression: Float[ndarray, " e"]
    landmarks2d: Float[ndarray, "m 2"]
    landmarks3d: Float[ndarray, "m 3"]
    visible: Bool[ndarray, " m"]
    attributes: Mapping[str, str | float]


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
    """

    model_name: str
    model_sha256: str
    pncc_limit_mm: float
    smallest_radius_mm: float
    licence: str
    configuration: str
    generator: str
    rejected: str = "[]"


# Small arrays that every sample has, and how they are stored.
PER_SAMPLE = {
    "camera": np.float64,
    "identity": np.float32,
    "expression": np.float32,
    "landmarks2d": np.float32,
    "landmarks3d": np.float32,
    "visible": np.bool_,
}


@final
class ShardReader:
    """Reads one shard; a sample at a time, nothing kept.

    Raises:
        InputFileError: The file is missing, no shard, truncated, or of a newer schema.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with _reading(path):
            self._file = h5py.File(path, "r")
            _check_format(self._file)
            fields = json.loads(str(self._file.attrs["header"]))
            self.header = ShardHeader(**fields)
            self.sample_ids: list[str] = [name.decode() for name in self._file["sample_id"][()]]
            self.offset_limits_mm: Float32[ndarray, " n"] = self._file["offset_limit_mm"][()]

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

    def image_bytes(self, index: int) -> bytes:
        """The encoded picture of a sample."""
        with _reading(self.path):
            return bytes(self._file["image"][index].tobytes())

    def image(self, index: int) -> UInt8[ndarray, "h w 3"]:
        """The picture of a sample, RGB."""
        return decode_image(self.image_bytes(index), f"{self.path}, sample {index}")

    def maps(self, index: int) -> FaceMaps:
        """The maps of a sample, mm."""
        with _reading(self.path):
            height, width = self._file["size_px"][index]
            pncc, offset = (self._file[name][index, :height, :width] for name in ("pncc", "offset"))
            mask = self._file["mask"][index, :height, :width].astype(bool)
        return FaceMaps(fixed_point_to_maps(pncc), fixed_point_to_maps(offset), mask)

    def stored_checksums(self) -> list[str]:
        """The checksum that was stored with each sample; nothing is recomputed."""
        with _reading(self.path):
            return [text.decode() for text in self._file["checksum"][()]]

    def checksum_pair(self, index: int) -> tuple[str, str]:
        """The checksum that was stored with a sample, and that of what is there now."""
        with _reading(self.path):
            return self._file["checksum"][index].decode(), sample_checksum(self._file, index)

    def landmarks2d(self, index: int) -> Float32[ndarray, "m 2"]:
        """The landmarks of a sample, px."""
        with _reading(self.path):
            return np.asarray(self._file["landmarks2d"][index])

    def triplet(self, index: int) -> Triplet:
        """Everything that is known of a sample."""
        with _reading(self.path):
            values: dict[str, Any] = {name: self._file[name][index] for name in PER_SAMPLE}
            height, width = self._file["size_px"][index]
            depth = (self._file["depth"][index, :height, :width] / DEPTH_STEPS_PER_MM).astype(np.float32)
            attributes = json.loads(self._file["attributes"][index])
        values["camera"] = Camera(values["camera"])
        return Triplet(
            sample_id=self.sample_ids[index],
            image=self.image_bytes(index),
            maps=self.maps(index),
            depth=depth,
            attributes=attributes,
            **values,
        )


def shard_paths(folder: Path) -> list[Path]:
    """The shards of a folder, sorted.

    Raises:
        UsageError: There is no such folder or no shard in it.
    """
    paths = sorted(folder.glob("shard-*.h5"))
    if not paths:
        found = "no shard-*.h5 in it" if folder.is_dir() else "no such folder"
        raise UsageError(
            f"{folder}: expected a folder of shards, found {found}; `datagen render --out {folder}` makes one"
        )
    return paths


def sample_checksum(file: h5py.File, index: int) -> str:
    """SHA-256 over the stored picture and arrays of a sample."""
    digest = hashlib.sha256(file["image"][index].tobytes())
    for name in ("size_px", "pncc", "offset", "mask", "depth", *PER_SAMPLE):
        digest.update(np.ascontiguousarray(file[name][index]).tobytes())
    return digest.hexdigest()


def _check_format(file: h5py.File) -> None:
    if file.attrs.get("format") != FORMAT:
        raise InputFileError(
            f"{file.filename}: expected a shard (format={FORMAT!r}), found format={file.attrs.get('format')!r}"
        )
    version = int(file.attrs["schema_version"])
    if version > SCHEMA_VERSION:
        raise InputFileError(
            f"{file.filename}: shard schema {version} is newer than {SCHEMA_VERSION}, which this version reads; "
            "upgrade pix2face"
        )


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turns what h5py raises on a missing, foreign or truncated file into one error of ours."""
    try:
        yield
    except FileNotFoundError as error:
        raise InputFileError(f"{path}: no such shard") from error
    except (OSError, KeyError, ValueError, RuntimeError, TypeError, UnicodeDecodeError) as error:
        raise InputFileError(
            f"{path}: expected a complete shard, found one that cannot be read ({error}); "
            "delete it and run `datagen render` again: it writes what is missing"
        ) from error
