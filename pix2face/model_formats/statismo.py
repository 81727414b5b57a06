"""Basel Face Models 2017 and 2019, and whatever else comes in statismo's layout (``.h5``).

``{shape,expression,color}/model/{mean, pcaBasis, pcaVariance}`` and ``shape/representer/{points, cells}``; one standard
deviation of a component is sqrt(pcaVariance) times its column. The mean expression is not zero: it belongs to the mean.

Source: Gerig et al. 2018, Morphable Face Models: An Open Framework.
"""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from jaxtyping import Float64, Int32
from numpy import ndarray
from scipy.spatial import KDTree

from pix2face.errors import InputFileError
from pix2face.files.checked_hdf5 import open_hdf5, read_array, read_text
from pix2face.geometry.landmarks import IBUG68, N_IBUG68
from pix2face.model_formats.checks import MM_PER_METRE, basis_of_columns, coordinates, triangle_polygons
from pix2face.model_formats.tables import MISSING, table_rows
from pix2face.models.model_file import StoredModel

MEAN = "shape/model/mean"
# A named landmark is a point of the reference mesh; farther from it than this, it belongs to another mesh.
LANDMARK_TOLERANCE_MM = 5.0


def is_statismo(file: h5py.File) -> bool:
    """Whether an HDF5 file is laid out as statismo does."""
    return MEAN in file and "shape/representer" in file


def read_statismo(path: Path) -> StoredModel:
    """Reads the model, in mm, in its own frame.

    Raises:
        InputFileError: Missing, truncated, foreign or hostile file, or arrays that do not fit each other.
    """
    with open_hdf5(path) as file:
        unit = _mm_per_unit(file, path)
        mean = coordinates(f"{path} ({MEAN})", read_array(file, MEAN, path)) * unit
        polygons = _polygons(file, path, len(mean))
        landmarks = _named_landmarks(file, path, len(mean), unit)
        expression = np.zeros((0, len(mean), 3), dtype=np.float32)
        if "expression/model/mean" in file:
            offset, expression = _component(file, path, "expression", len(mean), unit)
            mean = mean + offset
        return StoredModel(
            name=f"{path.stem} (statismo)",
            licence="as given by its makers; BFM 2017 and 2019: registration with the University of Basel, research "
            "only, not to be passed on",
            origin=f"{path.name}; for the Basel models: Gerig et al. 2018",
            mean=mean.astype(np.float32),
            identity_basis=_component(file, path, "shape", len(mean), unit)[1],
            expression_basis=expression,
            polygons=polygons,
            polygon_regions=np.zeros(len(polygons), np.uint8),
            landmarks={} if landmarks is None else {IBUG68: landmarks},
            **_albedo(file, path, len(mean)),
        )


def _component(
    file: h5py.File, path: Path, part: str, n_vertices: int, unit: float
) -> tuple[Float64[ndarray, "v 3"], ndarray]:
    """Mean and basis of one part, in units of mm or colour."""
    group = f"{part}/model"
    mean = coordinates(f"{path} ({group}/mean)", read_array(file, f"{group}/mean", path))
    with np.errstate(invalid="ignore"):  # a signalling NaN; it is found below
        variance = read_array(file, f"{group}/pcaVariance", path).astype(np.float64).ravel()
    if len(mean) != n_vertices or not (np.isfinite(variance) & (variance >= 0)).all():
        raise InputFileError(
            f"{path}: expected {n_vertices} vertices and variances of at least 0 in {group}, found {len(mean)} vertices"
        )
    columns = read_array(file, f"{group}/pcaBasis", path)
    return mean * unit, basis_of_columns(f"{path} ({group})", columns, np.sqrt(variance), n_vertices, unit)


def _polygons(file: h5py.File, path: Path, n_vertices: int) -> Int32[ndarray, "t 4"]:
    name = "shape/representer/cells"
    cells = read_array(file, name, path)
    if cells.ndim != 2 or cells.shape[0] != 3 or cells.dtype.kind not in "iu":
        raise InputFileError(f"{path}: expected triangles (3 x N) at {name}, found {cells.dtype} {cells.shape}")
    return triangle_polygons(f"{path} ({name})", cells.T.astype(np.int64), n_vertices)


def _mm_per_unit(file: h5py.File, path: Path) -> float:
    """From the unit's length in metres where the file says it; mm otherwise, as in the Basel models."""
    name = "shape/representer/length-unit"
    if name not in file:
        return 1.0
    unit = float(read_array(file, name, path).ravel()[0]) * MM_PER_METRE
    if not 1e-4 <= unit <= 1e4:
        raise InputFileError(f"{path}: expected a length unit in metres at {name}, found {unit / MM_PER_METRE}")
    return unit


def _named_landmarks(file: h5py.File, path: Path, n_vertices: int, unit: float) -> Int32[ndarray, "68"] | None:
    """The landmarks whose names mean points of iBUG-68, as vertices nearest to them on the reference mesh."""
    named = _landmark_coordinates(file, path)
    points = coordinates(f"{path} (points)", read_array(file, "shape/representer/points", path).T)
    known = {name: int(number) for number, name in table_rows("basel_names") if name in named}
    if not known or len(points) != n_vertices:
        return None
    distances, nearest = KDTree(points).query(np.stack([named[name] for name in known]))
    if float(np.max(distances)) * unit > LANDMARK_TOLERANCE_MM:
        return None
    vertices = np.full(N_IBUG68, MISSING, dtype=np.int32)
    vertices[list(known.values())] = nearest
    return vertices


def _landmark_coordinates(file: h5py.File, path: Path) -> dict[str, Float64[ndarray, "3"]]:
    """Names and places from the metadata, which exist as JSON and as lines of text."""
    try:
        if "metadata/landmarks/json" in file:
            rows = json.loads(read_text(file["metadata/landmarks/json"], path))
            found = {str(row["id"]): np.array(row["coordinates"], dtype=np.float64) for row in rows}
        elif "metadata/landmarks/text" in file:
            lines = (
                line.split() for line in read_text(file["metadata/landmarks/text"], path).splitlines() if line.strip()
            )
            found = {words[0]: np.array(words[2:5], dtype=np.float64) for words in lines}
        else:
            return {}
    except (ValueError, TypeError, KeyError, IndexError, RecursionError) as error:
        raise InputFileError(f"{path}: expected landmarks in metadata/landmarks, found none ({error})") from error
    return {name: place for name, place in found.items() if place.shape == (3,) and np.isfinite(place).all()}


def _albedo(file: h5py.File, path: Path, n_vertices: int) -> dict[str, Any]:
    """Colours (0..1) where the file has a colour for each vertex of the shape."""
    if "color/model/mean" not in file or file["color/model/mean"].size != 3 * n_vertices:
        return {}
    mean, basis = _component(file, path, "color", n_vertices, 1.0)
    return {"albedo_mean": mean.astype(np.float32), "albedo_basis": basis}
