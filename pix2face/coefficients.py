"""Coefficients of faces: what a renderer needs to know of each, as a table with a file of its own."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

import h5py
import numpy as np
from jaxtyping import Float, Float32, Float64, Int32
from numpy import ndarray

from pix2face.camera import Camera
from pix2face.errors import InputFileError

FORMAT = "pix2face-coefficients"
SCHEMA_VERSION = 1


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Face:
    """One face: its coefficients, the camera that sees it, and the picture that it belongs to.

    Attributes:
        sample_id: Unique in its source.
        identity: Standard deviations.
        expression: Standard deviations.
        camera: Sees the model in the picture.
        height_px: Height of the picture.
        width_px: Width of the picture.
        image_path: The photograph, or None where a picture is to be rendered.
        attributes: What else is known, to filter on.
    """

    sample_id: str
    identity: Float[ndarray, " k"]
    expression: Float[ndarray, " e"]
    camera: Camera
    height_px: int
    width_px: int
    image_path: Path | None = None
    attributes: Mapping[str, str | float] = field(default_factory=dict)


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class FaceCoefficients:
    """A table of faces of one model.

    Attributes:
        model_name: The model that the coefficients belong to.
        model_sha256: Its hash.
        sample_ids: One for each face, unique.
        identity: Standard deviations.
        expression: Standard deviations.
        cameras: One ``Camera.matrix`` for each face.
        sizes_px: Height and width of each picture.
        image_paths: Photographs, relative to the file; empty where a picture is to be rendered.
        configuration: How the table was made, as JSON.
    """

    model_name: str
    model_sha256: str
    sample_ids: tuple[str, ...]
    identity: Float32[ndarray, "n k"]
    expression: Float32[ndarray, "n e"]
    cameras: Float64[ndarray, "n 4 4"]
    sizes_px: Int32[ndarray, "n 2"]
    image_paths: tuple[str, ...]
    configuration: str = "{}"

    def __len__(self) -> int:
        return len(self.sample_ids)

    def face(self, index: int, folder: Path) -> Face:
        """One row. Photographs are looked for relative to ``folder``."""
        image_path = self.image_paths[index]
        return Face(
            sample_id=self.sample_ids[index],
            identity=self.identity[index],
            expression=self.expression[index],
            camera=Camera(self.cameras[index]),
            height_px=int(self.sizes_px[index, 0]),
            width_px=int(self.sizes_px[index, 1]),
            image_path=folder / image_path if image_path else None,
        )


def save_coefficients(table: FaceCoefficients, path: Path) -> None:
    """Writes a table; a file appears under its name only when it is complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.part")
    with h5py.File(temporary, "w", track_order=False) as file:
        file.attrs["format"] = FORMAT
        file.attrs["schema_version"] = SCHEMA_VERSION
        for name in ("model_name", "model_sha256", "configuration"):
            file.attrs[name] = getattr(table, name)
        for name in ("identity", "expression", "cameras", "sizes_px"):
            file.create_dataset(name, data=getattr(table, name), track_times=False)
        for name in ("sample_ids", "image_paths"):
            strings = np.array(getattr(table, name), dtype=h5py.string_dtype())
            file.create_dataset(name, data=strings, track_times=False)
    temporary.rename(path)


def load_coefficients(path: Path) -> FaceCoefficients:
    """Reads a table.

    Raises:
        InputFileError: The file is missing, no table, truncated, of a newer schema, or holds values that are not
            finite.
    """
    try:
        with h5py.File(path, "r") as file:
            _check_format(file, path)
            table = FaceCoefficients(
                **{name: str(file.attrs[name]) for name in ("model_name", "model_sha256", "configuration")},
                sample_ids=_strings(file["sample_ids"][()]),
                image_paths=_strings(file["image_paths"][()]),
                identity=file["identity"][()].astype(np.float32),
                expression=file["expression"][()].astype(np.float32),
                cameras=file["cameras"][()].astype(np.float64),
                sizes_px=file["sizes_px"][()].astype(np.int32),
            )
    except (OSError, KeyError, ValueError, RuntimeError, TypeError) as error:
        raise InputFileError(
            f"{path}: expected a table of coefficients (as `datagen sample` writes it), found a file that cannot be "
            f"read as one ({error})"
        ) from error
    _check_rows(table, path)
    return table


def configuration_to_json(configuration: Mapping[str, object]) -> str:
    """A resolved configuration as it is stored in everything that a command writes."""
    return json.dumps(configuration, sort_keys=True, default=str)


def _check_format(file: h5py.File, path: Path) -> None:
    found = file.attrs.get("format")
    if found != FORMAT:
        raise InputFileError(f"{path}: expected a table with format={FORMAT!r}, found format={found!r}")
    version = int(file.attrs["schema_version"])
    if version > SCHEMA_VERSION:
        raise InputFileError(
            f"{path}: schema {version} is newer than {SCHEMA_VERSION}, which this version reads; upgrade pix2face"
        )


def _check_rows(table: FaceCoefficients, path: Path) -> None:
    n = len(table)
    arrays = {name: getattr(table, name) for name in ("identity", "expression", "cameras", "sizes_px", "image_paths")}
    for name, values in arrays.items():
        if len(values) != n:
            raise InputFileError(f"{path}: expected {n} rows of {name}, found {len(values)}")
    for name in ("identity", "expression", "cameras"):
        bad = ~np.isfinite(arrays[name].reshape(n, -1)).all(axis=1)
        if bad.any():
            raise InputFileError(f"{path}: {name} of {table.sample_ids[int(bad.argmax())]!r} is not finite")
    if len(set(table.sample_ids)) < n:
        raise InputFileError(f"{path}: expected unique sample ids, found {n - len(set(table.sample_ids))} repeated")


def _strings(values: ndarray) -> tuple[str, ...]:
    return tuple(value.decode() for value in values.tolist())
