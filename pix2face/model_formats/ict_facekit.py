"""ICT-FaceKit light: a folder of OBJ files in cm. Each ``identityNNN`` minus neutral is one standard deviation.

Each expression file minus neutral is one component, too: a full blendshape counts as one standard deviation. Materials
become regions. Shells that are transparent in the original (tear fluid, occlusion and blend meshes, lashes) would hide
the eyes from a renderer of solid surfaces: their polygons are left out, their vertices stay, so that indices do.

Source: Li et al. 2020, Learning Formation of Physically-Based Face Attributes.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.opening import read_regular
from pix2face.geometry.landmarks import IBUG68
from pix2face.model_formats.checks import LARGEST_COORDINATE
from pix2face.model_formats.tables import ibug68_vertices
from pix2face.models.model_file import StoredModel

NEUTRAL = "generic_neutral_mesh.obj"
FOLDER = "FaceXModel"
MM_PER_CM = 10.0
N_VERTICES = 26719
LARGEST_FILE_BYTES = 64 << 20
_IDENTITY = re.compile(r"identity\d+")
_EXPRESSION = re.compile(r"[\w-]{1,64}")

REGIONS: Final = ("skin", "scalp", "mouth_inside", "teeth", "eyes", "iris")
FACE_REGIONS: Final = ("skin", "eyes", "iris")
_REGION_OF_MATERIAL: Final = {
    "M_Face": "skin",
    "M_BackHead": "scalp",
    "M_GumsTongue": "mouth_inside",
    "M_Teeth": "teeth",
    "M_ScleraLeft": "eyes",
    "M_ScleraRight": "eyes",
    "M_IrisLeft": "iris",
    "M_IrisRight": "iris",
}
_TRANSPARENT: Final = ("M_LacrimalFluid", "M_EyeBlend", "M_EyeOcclusion", "M_EyeLashes")


def model_folder(path: Path) -> Path | None:
    """The folder of the OBJ files, given it, the one above it, or a file in it."""
    folder = path if path.is_dir() else path.parent
    return next((found for found in (folder, folder / FOLDER) if (found / NEUTRAL).is_file()), None)


def read_ict_facekit(path: Path) -> StoredModel:
    """Reads the model, in mm, in its own frame (x to the subject's left, y up, z out of the face).

    Raises:
        InputFileError: A file is missing, damaged, or has another number of vertices than the neutral mesh.
    """
    folder = model_folder(path)
    if folder is None:
        raise InputFileError(f"{path}: expected a folder with {NEUTRAL} in it or in {FOLDER}, found none")
    neutral = _read_mesh(folder / NEUTRAL)
    shapes = [file for file in sorted(folder.glob("*.obj")) if file.name != NEUTRAL]
    identities = [file for file in shapes if _IDENTITY.fullmatch(file.stem)]
    expressions = [file for file in shapes if file not in identities and _EXPRESSION.fullmatch(file.stem)]
    one_each = np.eye(len(expressions), dtype=np.float32)
    n_vertices = len(neutral.vertices)
    return StoredModel(
        name="ICT-FaceKit light",
        licence="MIT, USC Institute for Creative Technologies",
        origin=f"Li et al. 2020; {len(identities)} identities, {len(expressions)} expressions",
        mean=(neutral.vertices * MM_PER_CM).astype(np.float32),
        identity_basis=_differences(neutral.vertices, identities),
        expression_basis=_differences(neutral.vertices, expressions),
        polygons=neutral.polygons,
        polygon_regions=neutral.regions,
        region_names=REGIONS,
        face_regions=FACE_REGIONS,
        landmarks={IBUG68: ibug68_vertices("ict_facekit", n_vertices)} if n_vertices == N_VERTICES else {},
        uv=neutral.uv,
        uv_polygons=neutral.uv_polygons,
        named_expressions={file.stem: row for file, row in zip(expressions, one_each, strict=True)},
    )


@final
@dataclass(frozen=True, eq=False)
class _Mesh:
    vertices: Float64[ndarray, "v 3"]
    polygons: Int32[ndarray, "p 4"]
    regions: UInt8[ndarray, " p"]
    uv: Float32[ndarray, "u 2"] | None
    uv_polygons: Int32[ndarray, "p 4"] | None


def _differences(neutral: Float64[ndarray, "v 3"], paths: list[Path]) -> Float32[ndarray, "k v 3"]:
    """The difference of each file from the neutral mesh, in mm."""
    basis = np.zeros((len(paths), len(neutral), 3), dtype=np.float32)
    for row, path in zip(basis, paths, strict=True):
        vertices = _numbers(path, [line for line in _lines(path) if line.startswith(b"v ")], 3)
        if len(vertices) != len(neutral):
            raise InputFileError(
                f"{path}: expected {len(neutral)} vertices as in {NEUTRAL}, found {len(vertices)}; is it cut off?"
            )
        row[:] = (vertices - neutral) * MM_PER_CM
    return basis


def _lines(path: Path) -> list[bytes]:
    return read_regular(path, "a mesh", LARGEST_FILE_BYTES).splitlines()


def _numbers(path: Path, lines: list[bytes], columns: int) -> Float64[ndarray, "n c"]:
    """The first numbers after the keyword of each line."""
    try:
        rows = np.array([line.split()[1 : columns + 1] for line in lines], dtype="S32").astype(np.float64)
    except ValueError as error:
        raise InputFileError(f"{path}: expected {columns} numbers on each line of vertices: {error}") from error
    if rows.shape != (len(lines), columns) or not len(lines) or not bool((np.abs(rows) < LARGEST_COORDINATE).all()):
        raise InputFileError(f"{path}: expected {columns} finite numbers on each line of vertices, found others")
    return rows


def _read_mesh(path: Path) -> _Mesh:
    lines = _lines(path)
    vertices = _numbers(path, [line for line in lines if line.startswith(b"v ")], 3)
    texture = [line for line in lines if line.startswith(b"vt ")]
    uv = _numbers(path, texture, 2).astype(np.float32) if texture else None
    polygons, regions = _read_polygons(path, lines)
    limits = len(vertices), len(texture)
    if (polygons.max(axis=(0, 1)) >= limits).any():
        raise InputFileError(f"{path}: expected faces of {limits} vertices and texture vertices, found others")
    corners, uv_corners = (np.ascontiguousarray(polygons[..., column]) for column in range(2))
    has_texture = uv is not None and bool((uv_corners[:, :3] >= 0).all())
    return _Mesh(vertices, corners, regions, uv if has_texture else None, uv_corners if has_texture else None)


def _read_polygons(path: Path, lines: list[bytes]) -> tuple[Int32[ndarray, "p 4 2"], UInt8[ndarray, " p"]]:
    """Corners (vertex, texture vertex; -1: none) and region of each polygon, transparent shells left out."""
    rows: list[list[tuple[int, int]]] = []
    regions: list[int] = []
    material = ""
    for number, line in enumerate(lines, 1):
        if line.startswith(b"usemtl "):
            material = line[7:].strip().decode("latin1")
        elif line.startswith(b"f ") and material not in _TRANSPARENT:
            corners = [_corner(path, number, word) for word in line.split()[1:]]
            if len(corners) not in (3, 4):
                raise InputFileError(f"{path}, line {number}: expected 3 or 4 corners, found {len(corners)}")
            rows.append(corners + [(-1, -1)] * (4 - len(corners)))
            regions.append(REGIONS.index(_REGION_OF_MATERIAL.get(material, "skin")))
    if not rows:
        raise InputFileError(f"{path}: expected faces, found none")
    return np.array(rows, dtype=np.int32), np.array(regions, dtype=np.uint8)


def _corner(path: Path, number: int, word: bytes) -> tuple[int, int]:
    """``vertex``, ``vertex/texture`` or ``vertex/texture/normal``, counted from 1."""
    parts = word.split(b"/")
    try:
        vertex, texture = int(parts[0]), int(parts[1]) if len(parts) > 1 and parts[1] else 0
    except ValueError as error:
        raise InputFileError(f"{path}, line {number}: expected numbers, found {word!r}") from error
    if not (0 < vertex < 2**31 and 0 <= texture < 2**31):
        raise InputFileError(f"{path}, line {number}: expected vertices counted from 1, found {word!r}")
    return vertex - 1, texture - 1
