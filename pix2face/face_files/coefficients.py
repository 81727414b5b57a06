"""Coefficients of faces: everything that a renderer needs of each face, as a table with its own file format."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, final

import h5py
import numpy as np
from jaxtyping import Float, Float32, Float64, Int32
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.checked_hdf5 import check_contained, fixed_text, open_unchecked, read_text, read_version
from pix2face.files.hdf5_writing import UnfailingFile
from pix2face.files.text_columns import ATTRIBUTES, json_lines, read_json_lines
from pix2face.files.writing import written_in_one_step
from pix2face.geometry.camera import Camera

FORMAT = "pix2face-coefficients"
SCHEMA_VERSION = 2
_A_TABLE = "a table of coefficients (as `datagen sample` writes it)"
# What OpenGL can draw everywhere; a table that asks for more, or a shard of more, is damaged.
LARGEST_SIDE_PX = 16384
# Type and shape of each column, rows aside; None is any length.
_COLUMNS: dict[str, tuple[Any, tuple[int | None, ...]]] = {
    "identity": (np.float32, (None,)),
    "expression": (np.float32, (None,)),
    "cameras": (np.float64, (4, 4)),
    "sizes_px": (np.int32, (2,)),
}


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Face:
    """One face: its coefficients, the camera that sees it, and the picture that it belongs to."""

    sample_id: str  # unique in its source
    identity: Float[ndarray, " k"]  # standard deviations
    expression: Float[ndarray, " e"]  # standard deviations
    camera: Camera  # from the model frame to the picture
    height_px: int
    width_px: int
    image_path: Path | None = None  # None where a picture is to be rendered
    attributes: Mapping[str, str | float] = field(default_factory=dict)  # what else is known, to filter on
    lighting: Float[ndarray, " l"] | None = None  # as the source describes it (``Illum_Para`` of 300W-LP), or None


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class FaceCoefficients:
    """A table of faces of one model."""

    model_name: str  # of the model that the coefficients belong to
    model_sha256: str
    sample_ids: tuple[str, ...]  # unique
    identity: Float32[ndarray, "n k"]  # standard deviations
    expression: Float32[ndarray, "n e"]  # standard deviations
    cameras: Float64[ndarray, "n 4 4"]  # each a ``Camera.matrix``
    sizes_px: Int32[ndarray, "n 2"]  # height and width of each picture
    image_paths: tuple[str, ...]  # relative to the file; empty where a picture is to be rendered
    configuration: str = "{}"  # how the table was made, as JSON
    licence: str = ""  # terms of what the table was made from; empty where nothing but the model's are known
    attributes: tuple[str, ...] = ()  # what else is known of each face, as JSON; none at all, or one for each
    lighting: Float32[ndarray, "n l"] | None = None  # NaN for a face where it is unknown
    rejected: tuple[tuple[str, str], ...] = ()  # what the source held and the table does not: id and reason

    def __len__(self) -> int:
        return len(self.sample_ids)

    def face(self, index: int, folder: Path) -> Face:
        """One row. Photographs are looked for relative to ``folder``."""
        image_path = self.image_paths[index]
        lighting = None if self.lighting is None else self.lighting[index]
        return Face(
            sample_id=self.sample_ids[index],
            identity=self.identity[index],
            expression=self.expression[index],
            camera=Camera(self.cameras[index]),
            height_px=int(self.sizes_px[index, 0]),
            width_px=int(self.sizes_px[index, 1]),
            image_path=folder / image_path if image_path else None,
            attributes=json.loads(self.attributes[index]) if self.attributes else {},
            lighting=None if lighting is None or np.isnan(lighting).any() else lighting,
        )


def save_coefficients(table: FaceCoefficients, path: Path) -> None:
    """Writes a table. The file appears under its name only when it is complete."""
    with (
        written_in_one_step(path) as temporary,
        UnfailingFile(temporary) as unfailing,
        h5py.File(unfailing, "w", track_order=False) as file,
    ):
        write_table_header(file, table)
        for name in (*_COLUMNS, *(["lighting"] if table.lighting is not None else [])):
            file.create_dataset(name, data=getattr(table, name), track_times=False)
        attributes = [json.loads(text) for text in table.attributes]
        for name, values in {
            "sample_ids": table.sample_ids,
            "image_paths": table.image_paths,
            "attributes": attributes,
            "rejected": table.rejected,
        }.items():
            file.create_dataset(name, data=json_lines(values), track_times=False)


def load_coefficients(path: Path) -> FaceCoefficients:
    """Reads a table.

    Raises:
        InputFileError: The file is missing, truncated, not a table, or of a newer schema; or it holds columns of other
            shapes, values that are not finite, or impossible picture sizes.
    """
    try:
        with open_unchecked(path, _A_TABLE) as file:
            _check_format(file, path)
            check_contained(file, path)
            sample_ids = tuple(read_json_lines(file, "sample_ids", path, str))
            n = len(sample_ids)
            image_paths = tuple(read_json_lines(file, "image_paths", path, str, n))
            columns: dict[str, Any] = {"sample_ids": sample_ids, "image_paths": image_paths}
            columns |= {name: _column(file, path, name, n) for name in _COLUMNS}
            if "lighting" in file:
                columns["lighting"] = _column(file, path, "lighting", n)
            for name in ("model_name", "model_sha256", "configuration"):
                columns[name] = read_text(file.attrs, path, name)
            columns["licence"] = read_text(file.attrs, path, "licence") if "licence" in file.attrs else ""
            if "attributes" in file:
                found = read_json_lines(file, "attributes", path, ATTRIBUTES, n if len(file["attributes"]) else 0)
                columns["attributes"] = tuple(map(json.dumps, found))
            if "rejected" in file:
                columns["rejected"] = tuple(read_json_lines(file, "rejected", path, tuple[str, str]))
    except (OSError, KeyError, ValueError, RuntimeError, TypeError, AttributeError) as error:
        raise InputFileError(
            f"{path}: expected {_A_TABLE}, found a file that cannot be read as one ({error})"
        ) from error
    table = FaceCoefficients(**columns)
    _check_rows(table, path)
    return table


def write_table_header(file: h5py.File, table: Any) -> None:
    """Writes what holds for all faces of a table: ``model_name``, ``model_sha256``, ``configuration``, ``licence``."""
    file.attrs["format"] = fixed_text(FORMAT)
    file.attrs["schema_version"] = SCHEMA_VERSION
    for name in ("model_name", "model_sha256", "configuration", "licence"):
        file.attrs[name] = fixed_text(getattr(table, name))


def moved_path(image_path: str, old_folder: Path, new_folder: Path) -> str:
    """Makes a photograph's path relative to another folder; an empty path stays empty."""
    return os.path.relpath(old_folder / image_path, new_folder) if image_path else ""


def configuration_to_json(configuration: Mapping[str, object]) -> str:
    """A resolved configuration as it is stored in everything that a command writes."""
    return json.dumps(configuration, sort_keys=True, default=str)


def _check_format(file: h5py.File, path: Path) -> None:
    # Schema 1 had text of variable length, which is not read here: damaged, it could end the process.
    is_old = "format" in file.attrs and file.attrs.get_id("format").dtype.kind == "O" and "sizes_px" in file
    found = FORMAT if is_old else read_text(file.attrs, path, "format") if "format" in file.attrs else None
    if found != FORMAT:
        raise InputFileError(f"{path}: expected a table with format={FORMAT!r}, found format={found!r}")
    version = read_version(file.attrs, path)
    if version > SCHEMA_VERSION:
        raise InputFileError(
            f"{path}: schema {version} is newer than {SCHEMA_VERSION}, which this version reads; upgrade pix2face"
        )
    if version < SCHEMA_VERSION or is_old:
        raise InputFileError(
            f"{path}: expected a table of schema {SCHEMA_VERSION}, found {version} of an earlier version; make it "
            "again (`datagen sample`, `datagen fit` or `datagen coeffs`)"
        )


def _column(file: h5py.File, path: Path, name: str, n: int) -> ndarray:
    dtype, shape = _COLUMNS.get(name, (np.float32, (None,)))  # lighting is like identity
    if not isinstance(file[name], h5py.Dataset) or file[name].dtype.kind not in "fiu":
        raise InputFileError(f"{path}: expected numbers as {name}, found {file[name]}")
    found = file[name].shape
    if len(found) != 1 + len(shape) or any(a not in (None, b) for a, b in zip((n, *shape), found, strict=True)):
        wanted = ", ".join("any" if length is None else str(length) for length in (n, *shape))
        raise InputFileError(f"{path}: expected {name} of shape ({wanted}), found {found}")
    return np.asarray(file[name][()].astype(dtype))


def _check_rows(table: FaceCoefficients, path: Path) -> None:
    n = len(table)
    for name in ("identity", "expression", "cameras"):
        values = getattr(table, name)
        bad = ~np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
        if bad.any():
            raise InputFileError(f"{path}: {name} of {table.sample_ids[int(bad.argmax())]!r} is not finite")
    outside = ((table.sizes_px < 1) | (table.sizes_px > LARGEST_SIDE_PX)).any(axis=1)
    if outside.any():
        index = int(outside.argmax())
        raise InputFileError(
            f"{path}: expected pictures of 1 to {LARGEST_SIDE_PX} pixels, found {table.sizes_px[index].tolist()} for "
            f"{table.sample_ids[index]!r}"
        )
    if len(set(table.sample_ids)) < n:
        raise InputFileError(f"{path}: expected unique sample ids, found {n - len(set(table.sample_ids))} repeated")
