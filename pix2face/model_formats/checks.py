"""Checks that all readers share: finite coordinates, bases that fit their mesh, polygons of existing vertices.

In all of them, ``where`` names the file and what is read from it, for messages.
"""

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, Int32
from numpy import ndarray

from pix2face.errors import InputFileError

MM_PER_METRE = 1000.0
MAX_COMPONENTS = 4096
# In any unit that is in use (a head measures 3e5 µm), and far from what single precision cannot hold.
LARGEST_COORDINATE = 1e12


def coordinates(where: str, values: Any) -> Float64[ndarray, "v 3"]:
    """Interleaved xyz as points.

    Raises:
        InputFileError: There are none, their number is not a multiple of 3, or some are not finite or absurdly large.
    """
    with np.errstate(invalid="ignore"):  # a signalling NaN; it is found below
        flat = np.asarray(values, dtype=np.float64).ravel()
    # "Not below" instead of "above", so that NaN counts, too.
    if not len(flat) or len(flat) % 3 or not bool((np.abs(flat) < LARGEST_COORDINATE).all()):
        raise InputFileError(f"{where}: expected 3 finite coordinates a vertex, found {len(flat)} numbers")
    return flat.reshape(-1, 3)


def basis_of_columns(
    where: str, columns: Any, deviations: Any, n_vertices: int, mm_per_unit: float
) -> Float32[ndarray, "k v 3"]:
    """Converts a matrix with one column for each component to a basis in mm for one standard deviation.

    Args:
        where: For messages.
        columns: (3 v, k).
        deviations: (k) factors of the columns that make one standard deviation; None if each column is one already.
        n_vertices: v.
        mm_per_unit: Unit of the columns times their factors.

    Raises:
        InputFileError: The shapes do not fit each other, or something is not finite.
    """
    matrix = np.asarray(columns)
    factors = np.ones(matrix.shape[-1]) if deviations is None else np.asarray(deviations, dtype=np.float64).ravel()
    if len(factors) > MAX_COMPONENTS:
        raise InputFileError(f"{where}: expected at most {MAX_COMPONENTS} components, found {len(factors)}")
    if matrix.shape != (3 * n_vertices, len(factors)):
        raise InputFileError(
            f"{where}: expected a basis of {3 * n_vertices} rows and {len(factors)} columns (one for each standard "
            f"deviation), found {matrix.shape}"
        )
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is found below
        rows = matrix.T.astype(np.float32) * (factors * mm_per_unit).astype(np.float32)[:, None]
    if not np.isfinite(rows).all():
        raise InputFileError(f"{where}: expected finite numbers, found some that are not")
    return np.ascontiguousarray(rows).reshape(len(factors), n_vertices, 3)


def vertex_numbers(where: str, values: Any, n_vertices: int, first: int = 0) -> Int32[ndarray, "..."]:
    """Numbers of vertices, counted from 0, in the shape that they come in; the file's first vertex is ``first``.

    Raises:
        InputFileError: There are none, or one names a vertex that does not exist.
    """
    numbers = np.asarray(values)
    last = n_vertices - 1 + first
    # Compared before the cast: NaN and numbers beyond the integers have no cast.
    if not numbers.size or not bool(((numbers >= first) & (numbers <= last)).all()):
        raise InputFileError(f"{where}: expected vertices {first} to {last}, found others")
    return (numbers.astype(np.int64) - first).astype(np.int32)


def triangle_polygons(where: str, triangles: Any, n_vertices: int, first: int = 0) -> Int32[ndarray, "t 4"]:
    """Triangles (t, 3) as polygons of the project's file; arguments and errors as ``vertex_numbers``."""
    if np.ndim(triangles) != 2 or np.shape(triangles)[1] != 3:
        raise InputFileError(f"{where}: expected triangles (n, 3), found {np.shape(triangles)}")
    corners = vertex_numbers(where, triangles, n_vertices, first)
    return np.column_stack([corners, np.full(len(corners), -1, dtype=np.int32)])


def wound_outward(vertices: ndarray, polygons: Int32[ndarray, "p 4"]) -> Int32[ndarray, "p 4"]:
    """Turns every polygon round where most of them face the origin, which is inside the head."""
    corners = vertices[polygons[:, :3]].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Summed areas, not counts: eyes and teeth are many small polygons.
    is_inward = float(np.einsum("tc,tc->", normals, corners.mean(axis=1))) < 0
    return turned_round(polygons) if is_inward else polygons


def turned_round(polygons: Int32[ndarray, "p 4"]) -> Int32[ndarray, "p 4"]:
    """The polygons seen from behind: corners in the opposite order, the first one kept."""
    quads, triangles = polygons[:, [0, 3, 2, 1]], polygons[:, [0, 2, 1, 3]]
    return np.ascontiguousarray(np.where(polygons[:, 3:] >= 0, quads, triangles))


def existing(folder: Path, *names: str) -> Path | None:
    """The first of several files that exists in a folder."""
    return next((folder / name for name in names if (folder / name).is_file()), None)


def check_names(path: Path, needed: Collection[str], found: Collection[str]) -> None:
    """Checks that a file has all arrays that its format needs.

    Raises:
        InputFileError: Some are missing.
    """
    missing = [name for name in needed if name not in found]
    if missing:
        raise InputFileError(
            f"{path}: expected {', '.join(needed)} in it, missing are {', '.join(missing)}; found {sorted(found)[:20]}"
        )
