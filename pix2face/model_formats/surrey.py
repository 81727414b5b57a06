"""Surrey Face Model, and other models that the eos library saves (``.bin``), with the blendshapes that come beside it.

Little-endian: u32 version; mean, basis, variances, each as rows, columns (i32) and column-major f32; u64 count and
triples of i32; a colour model of the same form, empty in the public file; u64 count and f64 texture coordinates.
Blendshapes: u64 count; for each, u64 length, name, and a matrix of one column.

The public file has version 1. Before the texture coordinates, version 2 adds an optional expression model (a byte that
is 1 where there is none; else i32: 0 for a PCA model, 1 for blendshapes; then the model), and version 3 optional
landmarks (the same byte, u64 count, names and i32 vertices). Version 4 ends with triangles of texture coordinates.

Source: Huber et al. 2016, A Multiresolution 3D Morphable Face Model and Fitting Framework; the eos library.
"""

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Float32, Float64, Int32
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
# A small number and a mean of one column tell the format; the layouts of these versions are known.
POSSIBLE_VERSIONS, KNOWN_VERSIONS = range(1, 64), range(1, 5)
BLENDSHAPE_PATTERN = "*blendshapes*.bin"
_HEAD = struct.Struct("<Iii")
_PCA_MODEL, _BLENDSHAPES = 0, 1
_NAME = re.compile(r"[\w +-]{1,64}")


def is_surrey(content: bytes) -> bool:
    """Whether a file starts as a Surrey model does: a version and a mean of one column."""
    if len(content) < _HEAD.size:
        return False
    version, rows, columns = _HEAD.unpack_from(content)
    return version in POSSIBLE_VERSIONS and columns == 1 and rows > 0 and rows % 3 == 0


def read_surrey(path: Path) -> StoredModel:
    """Reads the model, in mm, in its own frame (the face looks along +z, the origin lies in front of the nose).

    Blendshapes are looked for beside the file.

    Raises:
        InputFileError: Missing, truncated or foreign file, or arrays that do not fit each other.
    """
    reader = _Reader(path)
    version = reader.number("<I")
    if version not in KNOWN_VERSIONS:
        raise InputFileError(
            f"{path}: expected a model of the eos library of version {KNOWN_VERSIONS[0]} to {KNOWN_VERSIONS[-1]}, "
            f"found version {version}"
        )
    shape, colour = reader.pca_model(), reader.pca_model()
    mean = coordinates(f"{path} (mean)", shape.mean)
    polygons = triangle_polygons(f"{path} (triangles)", shape.triangles, len(mean))
    expression = reader.expression_model(len(mean)) if version >= 2 and reader.has_value() else None
    if expression is None or not len(expression.basis):
        expression = _Expression.of_shapes(_read_blendshapes(path.parent, len(mean)), len(mean))
    if version >= 3 and reader.has_value():
        reader.skip_landmarks()
    uv, uv_polygons = reader.texture(polygons, len(mean), has_triangles=version >= 4)
    n_shapes = len(expression.names)
    return StoredModel(
        name="Surrey Face Model",
        licence="University of Surrey: academic research and internal evaluation; the low resolution shape model is "
        "public, see its readme",
        origin=f"Huber et al. 2016, {path.name}" + (f"; {n_shapes} blendshapes" if n_shapes else ""),
        mean=(mean + expression.offset).astype(np.float32),
        identity_basis=basis_of_columns(f"{path} (basis)", shape.basis, shape.deviations(path), len(mean), 1.0),
        expression_basis=expression.basis,
        polygons=polygons,
        polygon_regions=np.zeros(len(polygons), np.uint8),
        landmarks={IBUG68: ibug68_vertices("surrey", len(mean))} if len(mean) == N_VERTICES else {},
        uv=uv,
        uv_polygons=uv_polygons,
        named_expressions=dict(zip(expression.names, np.eye(n_shapes, dtype=np.float32), strict=True)),
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
@dataclass(frozen=True, eq=False)
class _Expression:
    offset: Float64[ndarray, "v 3"]  # what the mean of a statistical model adds to the mean face
    basis: Float32[ndarray, "e v 3"]
    names: tuple[str, ...] = ()  # of blendshapes; a statistical model has none

    @classmethod
    def of_shapes(cls, shapes: dict[str, Float32[ndarray, "v 3"]], n_vertices: int) -> "_Expression":
        basis = np.stack(list(shapes.values())) if shapes else np.zeros((0, n_vertices, 3), np.float32)
        return cls(np.zeros((n_vertices, 3)), basis, tuple(shapes))


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

    def has_value(self) -> bool:
        """Whether an optional part follows: cereal writes a byte that is 1 where it is missing."""
        is_missing = self.number("<B")
        if is_missing > 1:
            raise InputFileError(f"{self._path}: expected 0 or 1 at {self._at - 1}, found {is_missing}")
        return not is_missing

    def text(self) -> str:
        return self.take(self.number("<Q")).decode("latin1")

    def expression_model(self, n_vertices: int) -> _Expression:
        kind = self.number("<i")
        if kind == _BLENDSHAPES:
            return _Expression.of_shapes(self.blendshapes(n_vertices), n_vertices)
        if kind != _PCA_MODEL:
            raise InputFileError(f"{self._path}: expected an expression model of kind 0 or 1, found {kind}")
        model, where = self.pca_model(), f"{self._path} (expressions)"
        offset = coordinates(where, model.mean)
        if len(offset) != n_vertices:
            raise InputFileError(f"{where}: expected {n_vertices} vertices, found {len(offset)}")
        deviations = model.deviations(self._path)
        return _Expression(offset, basis_of_columns(where, model.basis, deviations, n_vertices, 1.0))

    def blendshapes(self, n_vertices: int) -> dict[str, Float32[ndarray, "v 3"]]:
        shapes = dict[str, ndarray]()
        for _ in range(self.number("<Q")):
            name = self.text()
            offsets = coordinates(f"{self._path} ({name[:64]!r})", self.matrix())
            if not _NAME.fullmatch(name) or name in shapes or len(offsets) != n_vertices:
                raise InputFileError(
                    f"{self._path}: expected blendshapes with names of their own and {n_vertices} vertices, found "
                    f"{name[:64]!r} with {len(offsets)}"
                )
            shapes[name] = offsets.astype(np.float32)
        return shapes

    def skip_landmarks(self) -> None:
        """Names are free, so they say nothing of iBUG-68."""
        for _ in range(self.number("<Q")):
            self.text()
            self.number("<i")

    def texture(
        self, polygons: Int32[ndarray, "t 4"], n_vertices: int, *, has_triangles: bool
    ) -> tuple[Float32[ndarray, "u 2"] | None, Int32[ndarray, "t 4"] | None]:
        """Texture coordinates, v turned upward, and their polygons; None where they do not fit the mesh."""
        pairs = self.array("<f8", 2 * self.number("<Q")).reshape(-1, 2)
        corners = self.array("<i4", 3 * self.number("<Q")).reshape(-1, 3) if has_triangles else np.zeros((0, 3))
        if len(corners):
            own = triangle_polygons(f"{self._path} (texture triangles)", corners, len(pairs))
        else:
            own = polygons if len(pairs) == n_vertices else polygons[:0]
        if len(own) != len(polygons) or not bool((np.abs(pairs) < LARGEST_COORDINATE).all()):
            return None, None
        return np.column_stack([pairs[:, 0], 1 - pairs[:, 1]]).astype(np.float32), own


def _read_blendshapes(folder: Path, n_vertices: int) -> dict[str, Float32[ndarray, "v 3"]]:
    paths = sorted(folder.glob(BLENDSHAPE_PATTERN))
    return _Reader(paths[0]).blendshapes(n_vertices) if paths else {}


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
