"""Surrey Face Model as its public, shape-only file (``.bin``), with the expression blendshapes that come beside it.

Little-endian: u32 version; mean, basis, variances, each as rows, columns (i32) and column-major f32; u64 count and
triples of i32; a colour model of the same form, empty in the public file; u64 count and f64 texture coordinates.
Blendshapes: u64 count; for each, u64 length, name, and a matrix of one column.

Source: Huber et al. 2016, A Multiresolution 3D Morphable Face Model and Fitting Framework.
"""

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.opening import read_regular
from pix2face.geometry.landmarks import IBUG68
from pix2face.model_formats.checks import LARGEST_COORDINATE, basis_of_columns, coordinates, triangle_polygons
from pix2face.model_formats.tables import ibug68_vertices
from pix2face.models.model_file import StoredModel

N_VERTICES = 3448
# The largest resolution that is given out, with colours, takes 60 MB.
LARGEST_FILE_BYTES = 256 << 20
KNOWN_VERSIONS = range(1, 8)
BLENDSHAPE_PATTERN = "*blendshapes*.bin"
_HEAD = struct.Struct("<Iii")
_NAME = re.compile(r"[\w +-]{1,64}")


def is_surrey(content: bytes) -> bool:
    """Whether a file starts as a Surrey model does: a version and a mean of one column."""
    if len(content) < _HEAD.size:
        return False
    version, rows, columns = _HEAD.unpack_from(content)
    return version in KNOWN_VERSIONS and columns == 1 and rows > 0 and rows % 3 == 0


def read_surrey(path: Path) -> StoredModel:
    """Reads the model, in mm, in its own frame (the face looks along +z, the origin lies in front of the nose).

    Args:
        path: ``sfm_shape_3448.bin``; its blendshapes are looked for beside it.

    Raises:
        InputFileError: Missing, truncated or foreign file, or arrays that do not fit each other.
    """
    reader = _Reader(path)
    reader.number("<I")
    shape = reader.pca_model()
    colour = reader.pca_model()
    mean = coordinates(f"{path} (mean)", shape.mean)
    polygons = triangle_polygons(f"{path} (triangles)", shape.triangles, len(mean))
    uv = reader.texture_coordinates(len(mean))
    shapes = _read_blendshapes(path.parent, len(mean))
    expression = np.stack(list(shapes.values())) if shapes else np.zeros((0, len(mean), 3), np.float32)
    return StoredModel(
        name="Surrey Face Model",
        licence="University of Surrey: academic research and internal evaluation; the low resolution shape model is "
        "public, see its readme",
        origin=f"Huber et al. 2016, {path.name}" + (f"; {len(shapes)} blendshapes" if shapes else ""),
        mean=mean.astype(np.float32),
        identity_basis=basis_of_columns(f"{path} (basis)", shape.basis, shape.deviations(path), len(mean), 1.0),
        expression_basis=expression,
        polygons=polygons,
        polygon_regions=np.zeros(len(polygons), np.uint8),
        landmarks={IBUG68: ibug68_vertices("surrey", len(mean))} if len(mean) == N_VERTICES else {},
        uv=uv,
        uv_polygons=None if uv is None else polygons,
        named_expressions=dict(zip(shapes, np.eye(len(shapes), dtype=np.float32), strict=True)),
        **_albedo(path, colour, len(mean)),
    )


@final
@dataclass(frozen=True, eq=False)
class _PcaModel:
    mean: Float32[ndarray, " n"]
    basis: Float32[ndarray, "n k"]
    variances: Float32[ndarray, " k"]
    triangles: Int32[ndarray, "t 3"]

    def deviations(self, path: Path) -> ndarray:
        if not (np.isfinite(self.variances) & (self.variances >= 0)).all():
            raise InputFileError(f"{path}: expected variances of at least 0, found others")
        return np.sqrt(self.variances.astype(np.float64))


@final
class _Reader:
    """A file that is read from front to back; nothing is allocated that the rest of the file cannot fill."""

    def __init__(self, path: Path) -> None:
        self._path, self._at = path, 0
        self._content = read_regular(path, "a Surrey model", LARGEST_FILE_BYTES)

    def number(self, layout: str) -> int:
        return int(struct.unpack(layout, self.take(struct.calcsize(layout)))[0])

    def take(self, n_bytes: int) -> bytes:
        if not 0 <= n_bytes <= len(self._content) - self._at:
            raise InputFileError(
                f"{self._path}: expected {n_bytes} more bytes at {self._at}, found {len(self._content) - self._at}; "
                "the file is cut off or of another format"
            )
        self._at += n_bytes
        return self._content[self._at - n_bytes : self._at]

    def array(self, dtype: str, count: int) -> ndarray:
        return np.frombuffer(self.take(count * np.dtype(dtype).itemsize), dtype=dtype)

    def matrix(self) -> Float32[ndarray, "n k"]:
        rows, columns = self.number("<i"), self.number("<i")
        if rows < 0 or columns < 0:
            raise InputFileError(f"{self._path}: expected a matrix at {self._at}, found a size of {rows} x {columns}")
        return self.array("<f4", rows * columns).reshape(columns, rows).T.astype(np.float32)

    def pca_model(self) -> _PcaModel:
        mean, basis, variances = self.matrix(), self.matrix(), self.matrix()
        triangles = self.array("<i4", 3 * self.number("<Q")).reshape(-1, 3).astype(np.int32)
        return _PcaModel(mean.ravel(), basis, variances.ravel(), triangles)

    def texture_coordinates(self, n_vertices: int) -> Float32[ndarray, "u 2"] | None:
        """One pair a vertex, v turned upward; None where the file has none."""
        count = self.number("<Q")
        pairs = self.array("<f8", 2 * count).reshape(-1, 2)
        if count != n_vertices or not bool((np.abs(pairs) < LARGEST_COORDINATE).all()):
            return None
        return np.column_stack([pairs[:, 0], 1 - pairs[:, 1]]).astype(np.float32)


def _read_blendshapes(folder: Path, n_vertices: int) -> dict[str, Float32[ndarray, "v 3"]]:
    paths = sorted(folder.glob(BLENDSHAPE_PATTERN))
    if not paths:
        return {}
    path, shapes = paths[0], dict[str, ndarray]()
    reader = _Reader(path)
    for _ in range(reader.number("<Q")):
        name = reader.take(reader.number("<Q")).decode("latin1")
        offsets = coordinates(f"{path} ({name!r})", reader.matrix())
        if not _NAME.fullmatch(name) or name in shapes or len(offsets) != n_vertices:
            raise InputFileError(
                f"{path}: expected blendshapes with names of their own and {n_vertices} vertices, found {name!r} with "
                f"{len(offsets)}"
            )
        shapes[name] = offsets.astype(np.float32)
    return shapes


def _albedo(path: Path, colour: _PcaModel, n_vertices: int) -> dict[str, Any]:
    """The colour model that licensed files have; published in 0..1 or 0..255."""
    if len(colour.mean) != 3 * n_vertices:
        return {}
    scale = 1 / 255 if float(colour.mean.max()) > 1.5 else 1.0
    basis = basis_of_columns(f"{path} (colour)", colour.basis, colour.deviations(path), n_vertices, scale)
    return {
        "albedo_mean": (coordinates(f"{path} (colour)", colour.mean) * scale).astype(np.float32),
        "albedo_basis": basis,
    }
