"""Basel Face Model 2009 in the layouts that are in use, in µm; the frame is already the project's.

300W-LP's: ``Model_Shape.mat`` and ``Model_Expression.mat`` (also ``Model_Exp.mat``), 53,215 vertices, with
S = mu_shape + mu_exp + w Shape_Para + w_exp Exp_Para (docs/reference/conventions.md).

face3d's ``BFM.mat``: the same arrays in one structure, with other names.

The original: ``01_MorphableModel.mat``, 53,490 vertices, no expressions; or with ``Exp_Pca.bin`` and ``std_exp.txt``,
another expression basis than the one that ``Exp_Para`` refers to, on the 53,215 vertices.

Source: Paysan et al. 2009; Zhu et al. 2016; Guo et al. 2018 (Exp_Pca.bin).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64
from numpy import ndarray

from pix2face.errors import InputFileError, ModelMismatchError
from pix2face.files.mat_files import mat_names, read_mat
from pix2face.files.opening import open_regular, read_text_file
from pix2face.geometry.landmarks import IBUG68, N_IBUG68
from pix2face.model_formats.checks import (
    basis_of_columns,
    check_names,
    coordinates,
    existing,
    triangle_polygons,
    vertex_numbers,
    wound_outward,
)
from pix2face.model_formats.tables import ibug68_vertices, table_rows
from pix2face.models.model_file import StoredModel
from pix2face.models.morphable_model import MorphableModel

PUBLISHED_BASIS = "bfm2009-300wlp"
NEUTRAL_BASIS = "bfm2009-without-expressions"
GUO_BASIS = "bfm2009-guo"
SHAPE_FILE = "Model_Shape.mat"
EXPRESSION_FILES = ("Model_Expression.mat", "Model_Exp.mat")
ORIGINAL_FILE = "01_MorphableModel.mat"
# The structure of face3d's file, and what it calls the arrays of 300W-LP.
FACE3D = "model"
FACE3D_NAMES = {
    "mu_shape": "shapeMU",
    "w": "shapePC",
    "sigma": "shapeEV",
    "tri": "tri",
    "keypoints": "kpt_ind",
    "mu_exp": "expMU",
    "w_exp": "expPC",
    "sigma_exp": "expEV",
    "mu_tex": "texMU",
    "w_tex": "texPC",
    "sigma_tex": "texEV",
}
GUO_FILE, GUO_DEVIATIONS_FILE = "Exp_Pca.bin", "std_exp.txt"
TRIM_FILES = ("model_info.mat", "BFM_exp_idx.mat")
MM_PER_UM = 1e-3
ALBEDO_LEVELS = 255.0
N_ORIGINAL = 53490
MAX_GUO_COMPONENTS = 512
LARGEST_TEXT_BYTES = 1 << 20
LARGEST_BASIS_BYTES = 512 << 20

LICENCE = "Basel Face Model: registration with the University of Basel, research only; not to be passed on"


def standard_deviations_of_300wlp(
    model: MorphableModel,
) -> tuple[Float64[ndarray, " k"], Float64[ndarray, " e"]] | None:
    """What ``Shape_Para`` and ``Exp_Para`` are divided by to become standard deviations; None for another model.

    Raises:
        ModelMismatchError: A Basel Face Model 2009 with another expression basis than 300W-LP's: the identity would be
            right and every expression wrong.
    """
    if model.published_basis in (NEUTRAL_BASIS, GUO_BASIS):
        raise ModelMismatchError(
            f"coefficients of 300W-LP belong to the expression basis {PUBLISHED_BASIS!r} (29 components of "
            f"{EXPRESSION_FILES[0]}), found model {model.name} with {model.n_expression} expression components of the "
            f"basis {model.published_basis!r}; import {SHAPE_FILE} with {EXPRESSION_FILES[0]} instead"
        )
    if model.published_basis != PUBLISHED_BASIS or model.identity_unit is None or model.expression_unit is None:
        return None
    return model.identity_unit, model.expression_unit


def is_bfm2009(path: Path) -> bool:
    """Whether a MAT 5 file is one of the model's."""
    return bool({"mu_shape", "mu_exp", "shapeMU", f"{FACE3D}.shapeMU"} & set(mat_names(path)))


def read_bfm2009(path: Path) -> StoredModel:
    """Reads the model from one of its ``.mat`` files, or the folder that holds them.

    Raises:
        InputFileError: A file is missing, damaged, or its arrays do not fit each other.
    """
    if path.is_file() and f"{FACE3D}.shapeMU" in mat_names(path):
        return _read_face3d(path)
    folder = path if path.is_dir() else path.parent
    original, shape = existing(folder, ORIGINAL_FILE), existing(folder, SHAPE_FILE)
    if original is not None and (path == original or shape is None):
        return _read_original(original)
    expression = existing(folder, *EXPRESSION_FILES)
    if shape is None or expression is None:
        raise InputFileError(
            f"{folder}: expected {SHAPE_FILE} and {' or '.join(EXPRESSION_FILES)}, the two files that the face "
            f"profiling code of 300W-LP makes from the Basel Face Model, or {ORIGINAL_FILE}"
        )
    return _read_300wlp(shape, expression)


def _read_300wlp(shape_path: Path, expression_path: Path) -> StoredModel:
    shape = _read(shape_path, ("mu_shape", "w", "sigma", "tri", "keypoints"), ("mu_tex", "w_tex", "sigma_tex"))
    expression = _read(expression_path, ("mu_exp", "w_exp", "sigma_exp"))
    return _of_300wlp(shape_path, expression_path, shape, expression)


def _read_face3d(path: Path) -> StoredModel:
    """``BFM.mat`` of face3d: the arrays of 300W-LP under other names, in one structure."""
    names = {name: f"{FACE3D}.{theirs}" for name, theirs in FACE3D_NAMES.items()}
    needed = tuple(theirs for name, theirs in names.items() if not name.endswith("_tex"))
    fields = _read(path, needed, tuple(names.values()))
    named = {name: fields[theirs] for name, theirs in names.items() if theirs in fields}
    return _of_300wlp(path, path, named, named)


def _of_300wlp(
    shape_path: Path, expression_path: Path, shape: dict[str, ndarray], expression: dict[str, ndarray]
) -> StoredModel:
    mean_um = coordinates(f"{shape_path} (mu_shape)", shape["mu_shape"])
    offset_um = coordinates(f"{expression_path} (mu_exp)", expression["mu_exp"])
    n_vertices = len(mean_um)
    if len(offset_um) != n_vertices:
        raise InputFileError(f"{expression_path}: expected mu_exp of {n_vertices} vertices, found {len(offset_um)}")
    identity = _Basis.read(f"{shape_path} (w, sigma)", shape["w"], shape["sigma"], n_vertices)
    deformation = _Basis.read(
        f"{expression_path} (w_exp, sigma_exp)", expression["w_exp"], expression["sigma_exp"], n_vertices
    )
    keypoints = vertex_numbers(f"{shape_path} (keypoints)", shape["keypoints"].ravel(), n_vertices, first=1)
    if len(keypoints) != N_IBUG68:
        raise InputFileError(f"{shape_path}: expected {N_IBUG68} keypoints, found {len(keypoints)}")
    return _model(
        mean_um + offset_um,
        identity,
        deformation,
        triangle_polygons(f"{shape_path} (tri)", shape["tri"].reshape(3, -1).T, n_vertices, first=1),
        name="BFM 2009 (300W-LP)",
        origin="Paysan et al. 2009, expressions of Cao et al. 2014 as in Zhu et al. 2016",
        landmarks={IBUG68: keypoints},
        published_basis=PUBLISHED_BASIS,
        **albedo_of_255(shape_path, shape.get("mu_tex"), shape.get("w_tex"), shape.get("sigma_tex"), n_vertices),
    )


def _read_original(path: Path) -> StoredModel:
    """``01_MorphableModel.mat``; trimmed to 300W-LP's vertices where their list, or a basis on them, lies beside."""
    fields = _read(path, ("shapeMU", "shapePC", "shapeEV", "tl"), ("texMU", "texPC", "texEV"))
    mean_um = coordinates(f"{path} (shapeMU)", fields["shapeMU"])
    n_vertices = len(mean_um)
    identity = _Basis.read(f"{path} (shapePC, shapeEV)", fields["shapePC"], fields["shapeEV"], n_vertices)
    polygons = triangle_polygons(f"{path} (tl)", fields["tl"], n_vertices, first=1)
    albedo = albedo_of_255(path, fields.get("texMU"), fields.get("texPC"), fields.get("texEV"), n_vertices)
    guo = existing(path.parent, GUO_FILE)
    trim_path = existing(path.parent, *TRIM_FILES)
    kept = np.arange(n_vertices)
    if trim_path is not None:
        numbers = _read(trim_path, ("trimIndex",))["trimIndex"].ravel()
        kept = np.unique(vertex_numbers(f"{trim_path} (trimIndex)", numbers, n_vertices, first=1)).astype(np.int64)
    elif guo is not None and n_vertices == N_ORIGINAL:
        kept = np.setdiff1d(kept, inner_mouth_vertices())
    offset_um, deformation = np.zeros((len(kept), 3)), _Basis.none(len(kept))
    if guo is not None:
        offset_um, deformation = _read_guo(guo, len(kept))
    return _model(
        mean_um[kept] + offset_um,
        identity.of_vertices(kept),
        deformation,
        _polygons_of(polygons, kept, n_vertices),
        name="BFM 2009" + ("" if guo is None else " (expressions of Guo et al.)"),
        origin=f"Paysan et al. 2009, {path.name}" + ("" if guo is None else f" with {GUO_FILE}"),
        landmarks=_original_landmarks(kept, n_vertices),
        published_basis=NEUTRAL_BASIS if guo is None else GUO_BASIS,
        **{name: np.ascontiguousarray(array[..., kept, :]) for name, array in albedo.items()},
    )


def inner_mouth_vertices() -> Int64[ndarray, " n"]:
    """The vertices of the original model that 300W-LP leaves out."""
    rows = table_rows("bfm2009_inner_mouth")
    return np.concatenate([np.arange(int(first), int(last) + 1) for first, last in rows]).astype(np.int64)


@final
@dataclass(frozen=True, eq=False)
class _Basis:
    mm: Float32[ndarray, "k v 3"]
    unit: Float64[ndarray, " k"]

    @classmethod
    def read(cls, where: str, columns: Any, deviations: Any, n_vertices: int) -> "_Basis":
        unit = np.asarray(deviations, dtype=np.float64).ravel()
        return cls(basis_of_columns(where, columns, unit, n_vertices, MM_PER_UM), unit)

    @classmethod
    def none(cls, n_vertices: int) -> "_Basis":
        return cls(np.zeros((0, n_vertices, 3), np.float32), np.zeros(0))

    def of_vertices(self, kept: Int64[ndarray, " n"]) -> "_Basis":
        return self if len(kept) == self.mm.shape[1] else _Basis(np.ascontiguousarray(self.mm[:, kept]), self.unit)


def _model(
    mean_um: Float64[ndarray, "v 3"],
    identity: _Basis,
    deformation: _Basis,
    polygons: Int32[ndarray, "t 4"],
    **others: Any,
) -> StoredModel:
    mean = (mean_um * MM_PER_UM).astype(np.float32)
    return StoredModel(
        licence=LICENCE,
        mean=mean,
        identity_basis=identity.mm,
        expression_basis=deformation.mm,
        polygons=wound_outward(mean, polygons),
        polygon_regions=np.zeros(len(polygons), np.uint8),
        identity_unit=identity.unit,
        expression_unit=deformation.unit,
        **others,
    )


def albedo_of_255(path: Path, mean: Any, columns: Any, deviations: Any, n_vertices: int) -> dict[str, Any]:
    """Colours that are published in 0..255, where the file has all three arrays.

    Raises:
        InputFileError: They are not the colours of the vertices.
    """
    if mean is None or columns is None or deviations is None:
        return {}
    colours = coordinates(f"{path} (mean colour)", mean)
    factors = np.asarray(deviations, dtype=np.float64).ravel()
    basis = basis_of_columns(f"{path} (colour basis)", columns, factors, n_vertices, 1 / ALBEDO_LEVELS)
    if len(colours) != n_vertices:
        raise InputFileError(f"{path}: expected a colour for each of {n_vertices} vertices, found {len(colours)}")
    return {"albedo_mean": (colours / ALBEDO_LEVELS).astype(np.float32), "albedo_basis": basis}


def _read_guo(path: Path, n_vertices: int) -> tuple[Float64[ndarray, "v 3"], _Basis]:
    """``Exp_Pca.bin``: i32 count, f32 mean, f32 components one after the other; ``std_exp.txt``: their deviations."""
    with open_regular(path, "an expression basis", LARGEST_BASIS_BYTES) as file:
        size = path.stat().st_size
        count = int.from_bytes(file.read(4), "little", signed=True)
        expected = 4 + 4 * 3 * n_vertices * (1 + count)
        if not 0 < count <= MAX_GUO_COMPONENTS or size != expected:
            raise InputFileError(
                f"{path}: expected a count of components and {n_vertices} vertices for the mean and each of them, "
                f"found a count of {count} in {size} bytes"
            )
        values = np.frombuffer(file.read(), dtype="<f4").reshape(1 + count, 3 * n_vertices)
    deviations = _read_deviations(path.parent / GUO_DEVIATIONS_FILE, count)
    mean = coordinates(f"{path} (mean)", values[0])
    return mean, _Basis.read(str(path), values[1:].T, deviations, n_vertices)


def _read_deviations(path: Path, count: int) -> Float64[ndarray, " k"]:
    try:
        text = read_text_file(path, f"the standard deviations of {GUO_FILE}", LARGEST_TEXT_BYTES, "ascii")
        values = np.array(text.split(), dtype=np.float64)
    except ValueError as error:
        raise InputFileError(f"{path}: expected the standard deviations of {GUO_FILE} in it ({error})") from error
    if len(values) < count or not np.isfinite(values).all():
        raise InputFileError(f"{path}: expected {count} finite numbers, found {len(values)}")
    return values[:count]


def _polygons_of(polygons: Int32[ndarray, "t 4"], kept: Int64[ndarray, " n"], n_vertices: int) -> Int32[ndarray, "k 4"]:
    """The polygons all of whose corners are kept, in the numbering of those."""
    new = np.full(n_vertices + 1, -1, dtype=np.int32)  # the last entry stands for "no corner"
    new[kept] = np.arange(len(kept))
    return np.ascontiguousarray(new[polygons][(new[polygons[:, :3]] >= 0).all(axis=1)])


def _original_landmarks(kept: Int64[ndarray, " n"], n_vertices: int) -> dict[str, Int32[ndarray, " _"]]:
    """300W-LP's keypoints, numbered among the kept vertices of the original."""
    if n_vertices != N_ORIGINAL:
        return {}
    trimmed = np.setdiff1d(np.arange(N_ORIGINAL), inner_mouth_vertices())
    original = trimmed[ibug68_vertices("bfm2009", len(trimmed))]
    new = np.full(N_ORIGINAL, -1, dtype=np.int32)
    new[kept] = np.arange(len(kept))
    return {IBUG68: new[original]}


def _read(path: Path, names: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict[str, ndarray]:
    check_names(path, names, mat_names(path))
    return read_mat(path, (*names, *optional))
