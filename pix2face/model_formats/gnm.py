"""GNM Head v3 (``gnm_head.npz``): template, identity and expression bases in metres, quads or triangles.

No copy was at hand: the reader is tested on files of ours in this layout.

Source: the array names of its public code.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.npz_files import read_npz
from pix2face.model_formats.checks import (
    MM_PER_METRE,
    basis_of_columns,
    check_names,
    coordinates,
    triangle_polygons,
    vertex_numbers,
)
from pix2face.models.model_file import StoredModel

TEMPLATE = "template_vertex_positions"
LARGEST_FILE_BYTES = 1 << 30


def read_gnm(path: Path) -> StoredModel:
    """Reads the model, in mm, in its own frame (x to the subject's left, y up, z out of the face).

    Raises:
        InputFileError: Missing, truncated, foreign or hostile file, or arrays that do not fit each other.
    """
    needed = (TEMPLATE, "vertex_identity_basis", "expression_basis")
    arrays = read_npz(path, (*needed, "quads", "triangles"), "an .npz of arrays", LARGEST_FILE_BYTES)
    check_names(path, needed, arrays)
    texts = [name for name, array in arrays.items() if array.dtype.kind not in "fiu"]
    if texts:
        raise InputFileError(f"{path}: expected numbers in {texts[0]}, found text")
    mean = coordinates(f"{path} ({TEMPLATE})", arrays[TEMPLATE]) * MM_PER_METRE
    polygons = _polygons(path, arrays, len(mean))
    return StoredModel(
        name="GNM Head",
        licence="Apache-2.0",
        origin=f"GNM, {path.name}",
        mean=mean.astype(np.float32),
        identity_basis=_basis(path, "vertex_identity_basis", arrays, len(mean)),
        expression_basis=_basis(path, "expression_basis", arrays, len(mean)),
        polygons=polygons,
        polygon_regions=np.zeros(len(polygons), np.uint8),
    )


def _basis(path: Path, name: str, arrays: dict[str, ndarray], n_vertices: int) -> Float32[ndarray, "k v 3"]:
    basis = arrays[name]
    if basis.ndim != 3 or basis.shape[1:] != (n_vertices, 3):
        raise InputFileError(f"{path}: expected {name} of (components, {n_vertices}, 3), found {basis.shape}")
    columns = basis.reshape(len(basis), 3 * n_vertices).T
    return basis_of_columns(f"{path} ({name})", columns, None, n_vertices, MM_PER_METRE)


def _polygons(path: Path, arrays: dict[str, ndarray], n_vertices: int) -> Int32[ndarray, "p 4"]:
    """Quads where the file has them (one that repeats its third corner is a triangle), else triangles."""
    quads, triangles = arrays.get("quads"), arrays.get("triangles")
    if quads is not None and quads.ndim == 2 and quads.shape[1] == 4:
        corners = vertex_numbers(f"{path} (quads)", quads, n_vertices)
        fourth = np.where(corners[:, 3] == corners[:, 2], -1, corners[:, 3])
        return np.column_stack([corners[:, :3], fourth]).astype(np.int32)
    if triangles is None:
        raise InputFileError(f"{path}: expected quads (n, 4) or triangles (n, 3), found neither")
    return triangle_polygons(f"{path} (triangles)", triangles, n_vertices)
