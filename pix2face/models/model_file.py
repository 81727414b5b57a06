"""The project's own file of a morphable model: one ``.h5`` whatever the source (layout: docs/reference)."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, final

import h5py
import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.checked_hdf5 import fixed_text, open_hdf5, read_text, read_version
from pix2face.files.hdf5_writing import UnfailingFile
from pix2face.files.json_text import parse_json
from pix2face.files.opening import is_regular
from pix2face.files.writing import written_in_one_step

FORMAT = "pix2face-morphable-model"
SCHEMA_VERSION = 1


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Alignment:
    """How an imported model was aligned with the model frame. The only scale applied is that of the published unit."""

    frame_from_file: Float64[ndarray, "4 4"]  # rigid transform (mm) from the published frame to the project's
    residual_mm: float  # RMS distance that is left to the built-in model's landmarks or surface
    landmark_scale: float  # that a similarity fit to the landmarks would have wanted; NaN where there are none


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearModel:
    """What the file and the model in memory have in common: mean, bases, and the tables of the vertices.

    Lengths are in mm, in the model frame: x to the subject's left, y up, z out of the face, origin inside the head.
    """

    name: str  #: what the model is called in messages and reports
    licence: str  #: terms under which the model may be used
    origin: str  #: where it comes from, for people
    mean: Float32[ndarray, "v 3"]  #: vertices with all coefficients zero, expression mean included
    identity_basis: Float32[ndarray, "k v 3"]  #: for one standard deviation
    expression_basis: Float32[ndarray, "e v 3"]  #: for one standard deviation
    region_names: tuple[str, ...] = ("skin",)  #: one, unless the model tells parts apart
    face_regions: tuple[str, ...] = ("skin",)  #: the regions where maps hold
    #: For each scheme the vertex of each landmark, in the scheme's order; of the mesh as it is after refinement.
    landmarks: Mapping[str, Int32[ndarray, " _"]] = field(default_factory=dict)
    uv: Float32[ndarray, "u 2"] | None = None  #: texture coordinates, v upward
    symmetry: Int32[ndarray, " v"] | None = None  #: for each vertex its mirror image; None for a mesh without symmetry
    #: Expression coefficients of shapes that have a name.
    named_expressions: Mapping[str, Float32[ndarray, " e"]] = field(default_factory=dict)
    published_basis: str = ""  #: name of the published basis whose coefficient files the model understands
    #: One standard deviation of each identity component in the unit of those files.
    identity_unit: Float64[ndarray, " k"] | None = None
    expression_unit: Float64[ndarray, " e"] | None = None  #: likewise for expression
    #: Which of the 68 iBUG landmarks came by correspondence with the built-in model on import.
    approximate_landmarks: Int32[ndarray, " _"] | None = None
    albedo_mean: Float32[ndarray, "v 3"] | None = None  #: colour of each vertex, RGB, 0..1, encoded as published
    albedo_basis: Float32[ndarray, "a v 3"] | None = None  #: for one standard deviation


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class StoredModel(LinearModel):
    """A model as its file holds it: at the control mesh, before refinement."""

    polygons: Int32[ndarray, "p 4"]  # quads, counter-clockwise seen from outside; a triangle has -1 in the last place
    polygon_regions: UInt8[ndarray, " p"]  # indices into ``region_names``
    uv_polygons: Int32[ndarray, "p 4"] | None = None  # for each polygon its texture coordinates
    source_vertices: Int32[ndarray, " v"] | None = None  # indices in the mesh that the model was made from
    refinement_steps: int = 0  # Catmull-Clark steps that loading does by default
    alignment: Alignment | None = None  # how the model came to this frame; None where it stands as published


_ARRAYS: dict[str, Any] = {
    "mean": np.float32,
    "polygons": np.int32,
    "polygon_regions": np.uint8,
    "uv": np.float32,
    "uv_polygons": np.int32,
    "symmetry": np.int32,
    "source_vertices": np.int32,
    "identity_unit": np.float64,
    "expression_unit": np.float64,
    "approximate_landmarks": np.int32,
    "albedo_mean": np.float32,
    "albedo_basis": np.float32,
}
_TEXTS, _LISTS = ("name", "licence", "origin", "published_basis"), ("region_names", "face_regions")
_ALIGNMENT = ("frame_from_file", "residual_mm", "landmark_scale")
# Random-looking floats hardly shrink, and unpacking them costs every process that opens the model a second.
COMPRESSED_BYTES = 4 << 20


def write_stored_model(model: StoredModel, path: Path, *, quantise: bool = False) -> None:
    """Writes a model. The folder of the file is created.

    With ``quantise`` the bases are stored as int16 with one step per component: 1/32767 of its largest value. That
    takes a quarter of the size. Imported models are not quantised, so they stay exact.
    """
    with (
        written_in_one_step(path) as temporary,
        UnfailingFile(temporary) as unfailing,
        h5py.File(unfailing, "w", track_order=False) as file,
    ):
        file.attrs["format"] = fixed_text(FORMAT)
        file.attrs["schema_version"] = SCHEMA_VERSION
        for name in _TEXTS:
            file.attrs[name] = fixed_text(getattr(model, name))
        file.attrs["refinement_steps"] = model.refinement_steps
        for name in _LISTS:
            file.attrs[name] = fixed_text(json.dumps(getattr(model, name)))
        for name in _ARRAYS:
            _write_array(file, name, getattr(model, name))
        _write_basis(file, "identity_basis", model.identity_basis, quantise)
        _write_basis(file, "expression_basis", model.expression_basis, quantise)
        for name, indices in model.landmarks.items():
            _write_array(file, f"landmarks/{name}", indices)
        for name, coefficients in model.named_expressions.items():
            _write_array(file, f"named_expressions/{name}", coefficients)
        if model.alignment is not None:
            for name in _ALIGNMENT:
                _write_array(file, f"alignment/{name}", np.asarray(getattr(model.alignment, name), dtype=np.float64))


def read_stored_model(path: Path) -> tuple[StoredModel, str]:
    """Reads a model, and the SHA-256 of its attributes and arrays (not of the file: compression does not matter).

    Raises:
        InputFileError: The file is missing, not a model, truncated, or of a newer schema.
    """
    if not is_regular(path):
        raise InputFileError(f"{path}: no such model file; `datagen model import` makes one, `builtin` needs none")
    try:
        with open_hdf5(path) as file:
            _check_format(file, path)
            arrays = _arrays(file)
            sha256 = _content_sha256(file, arrays, path)
            return _checked(_read(file, arrays, path), path), sha256
    except (OSError, KeyError, ValueError, RuntimeError, TypeError) as error:
        raise InputFileError(
            f"{path}: expected a model in the project's .h5 layout, found a file that cannot be read as one ({error})"
        ) from error


def _arrays(file: h5py.File) -> dict[str, ndarray]:
    """All arrays by their names, as they are stored: unfolding them takes most of the time, and is done once."""
    items: list[tuple[str, h5py.Dataset]] = []
    file.visititems(lambda name, item: items.append((name, item)) if isinstance(item, h5py.Dataset) else None)
    for name, item in items:
        if item.shape is None or item.dtype.kind not in "fiubS":  # damaged text of variable length can end the process
            raise TypeError(f"{name} is no array of numbers")
    return {name: item[()] for name, item in items}


def _read(file: h5py.File, arrays: Mapping[str, ndarray], path: Path) -> StoredModel:
    content: dict[str, Any] = {
        **{name: read_text(file.attrs, path, name) for name in _TEXTS},
        **{name: parse_json(read_text(file.attrs, path, name), tuple[str, ...]) for name in _LISTS},
        **{name: _array(arrays, name, dtype) for name, dtype in _ARRAYS.items() if name in file},
    }
    return StoredModel(
        **content,
        identity_basis=_read_basis(arrays, "identity_basis"),
        expression_basis=_read_basis(arrays, "expression_basis"),
        landmarks={name: _array(arrays, f"landmarks/{name}", np.int32) for name in file.get("landmarks", ())},
        named_expressions={
            name: _array(arrays, f"named_expressions/{name}", np.float32) for name in file.get("named_expressions", ())
        },
        refinement_steps=read_version(file.attrs, path, "refinement_steps"),
        alignment=_read_alignment(arrays),
    )


def _read_alignment(arrays: Mapping[str, ndarray]) -> Alignment | None:
    if not any(name.startswith("alignment/") for name in arrays):
        return None
    frame = _array(arrays, "alignment/frame_from_file", np.float64)
    residual, scale = (float(arrays[f"alignment/{name}"]) for name in _ALIGNMENT[1:])
    return Alignment(frame_from_file=frame, residual_mm=residual, landmark_scale=scale)


def _checked(model: StoredModel, path: Path) -> StoredModel:
    """The model, if its arrays fit each other: a damaged index would be met far from here otherwise."""
    n = len(model.mean)
    bases = [model.identity_basis, model.expression_basis]
    if model.albedo_basis is not None:
        bases.append(model.albedo_basis)
    tables = [model.polygons, *([] if model.symmetry is None else [model.symmetry])]
    if model.refinement_steps == 0:  # otherwise landmarks may be vertices that refinement makes
        tables += model.landmarks.values()
    fits = (
        model.mean.shape == (n, 3)
        and all(basis.ndim == 3 and basis.shape[1:] == (n, 3) for basis in bases)
        and model.polygons.ndim == 2
        and model.polygons.shape[1] == 4
        and len(model.polygon_regions) == len(model.polygons)
        and int(model.polygon_regions.max(initial=0)) < max(len(model.region_names), 1)
        and all(int(table.max(initial=-1)) < n for table in tables)
        and all(int(table.min(initial=0)) >= 0 for table in [model.polygons[:, :3], *tables[1:]])
        and bool(np.isfinite(model.mean).all())
    )
    if not fits:
        raise InputFileError(
            f"{path}: expected a model whose tables fit its {n} vertices, found some that do not; import it again"
        )
    return model


def _check_format(file: h5py.File, path: Path) -> None:
    found = read_text(file.attrs, path, "format") if "format" in file.attrs else None
    if found != FORMAT:
        raise InputFileError(
            f"{path}: expected a file with format={FORMAT!r}, found format={found!r}; "
            "published models are brought into it by `datagen model import`"
        )
    version = read_version(file.attrs, path)
    if version > SCHEMA_VERSION:
        raise InputFileError(
            f"{path}: model schema {version} is newer than {SCHEMA_VERSION}, which this version reads; upgrade pix2face"
        )


def _write_array(file: h5py.File, name: str, array: ndarray | None) -> None:
    if array is not None:
        compressed = array.size > 0 and array.ndim and (array.dtype == np.int16 or array.nbytes <= COMPRESSED_BYTES)
        options: dict[str, Any] = {"compression": "gzip", "compression_opts": 9, "shuffle": True} if compressed else {}
        file.create_dataset(name, data=array, track_times=False, **options)


def _write_basis(file: h5py.File, name: str, basis: ndarray, quantise: bool) -> None:
    if not quantise or not basis.size:
        _write_array(file, name, basis)
        return
    step = np.abs(basis).reshape(len(basis), -1).max(axis=1) / 32767
    step = np.where(step > 0, step, 1).astype(np.float32)
    _write_array(file, name, np.rint(basis / step[:, None, None]).astype(np.int16))
    _write_array(file, f"{name}_step", step)


def _read_basis(arrays: Mapping[str, ndarray], name: str) -> Float32[ndarray, "k v 3"]:
    basis = _array(arrays, name, np.float32)
    if f"{name}_step" in arrays:
        basis *= _array(arrays, f"{name}_step", np.float32)[:, None, None]
    return basis


def _array(arrays: Mapping[str, ndarray], name: str, dtype: Any) -> ndarray:
    if arrays[name].dtype.kind not in "fiub":
        raise TypeError(f"{name} is no array of numbers")
    with np.errstate(invalid="ignore", over="ignore"):  # NaN as a number of a vertex is found below
        return np.asarray(arrays[name]).astype(dtype, copy=False)


def _content_sha256(file: h5py.File, arrays: Mapping[str, ndarray], path: Path) -> str:
    digest = hashlib.sha256()
    for name in sorted(file.attrs):
        is_text = name in (*_TEXTS, *_LISTS, "format")
        digest.update(
            f"{name}={read_text(file.attrs, path, name) if is_text else read_version(file.attrs, path, name)};".encode()
        )
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name}:{array.dtype.str}:{array.shape};".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
