"""Basel Face Model 2009 as 300W-LP uses it: ``Model_Shape.mat`` and ``Model_Expression.mat`` (also ``Model_Exp.mat``).

S = mu_shape + mu_exp + w Shape_Para + w_exp Exp_Para, in µm (docs/conventions.md). The frame is already the project's:
x to the subject's left, y up, z out of the face, origin inside the head.

Source: Paysan et al. 2009; Zhu et al. 2016.
"""

from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from jaxtyping import Float64, Int32
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.landmarks import IBUG68
from pix2face.model_file import StoredModel
from pix2face.morphable_model import MorphableModel

PUBLISHED_BASIS = "bfm2009-300wlp"
SHAPE_FILE = "Model_Shape.mat"
EXPRESSION_FILES = ("Model_Expression.mat", "Model_Exp.mat")
MM_PER_UM = 1e-3


def standard_deviations_of_300wlp(
    model: MorphableModel,
) -> tuple[Float64[ndarray, " k"], Float64[ndarray, " e"]] | None:
    """What ``Shape_Para`` and ``Exp_Para`` are divided by to become standard deviations; None for another basis."""
    if model.published_basis != PUBLISHED_BASIS or model.identity_unit is None or model.expression_unit is None:
        return None
    return model.identity_unit, model.expression_unit


def read_bfm2009(path: Path) -> StoredModel:
    """Reads the model.

    Args:
        path: ``Model_Shape.mat``, or the folder that holds it and the expression file.

    Raises:
        InputFileError: A file is missing, damaged, or its arrays do not fit each other.
    """
    folder = path if path.is_dir() else path.parent
    shape_path = folder / SHAPE_FILE
    expression_path = next((folder / name for name in EXPRESSION_FILES if (folder / name).is_file()), None)
    if not shape_path.is_file() or expression_path is None:
        raise InputFileError(
            f"{folder}: expected {SHAPE_FILE} and {' or '.join(EXPRESSION_FILES)}, the two files that the face "
            "profiling code of 300W-LP makes from the Basel Face Model"
        )
    shape = _read(shape_path, ("mu_shape", "w", "sigma", "tri", "keypoints"))
    expression = _read(expression_path, ("mu_exp", "w_exp", "sigma_exp"))
    mean_um = _column(shape_path, shape, "mu_shape") + _column(expression_path, expression, "mu_exp")
    mean = (mean_um.reshape(-1, 3) * MM_PER_UM).astype(np.float32)
    identity, identity_unit = _basis(shape_path, shape["w"], shape["sigma"], len(mean_um))
    deformation, expression_unit = _basis(expression_path, expression["w_exp"], expression["sigma_exp"], len(mean_um))
    triangles = _indices(shape_path, shape["tri"], "tri", len(mean)).reshape(3, -1).T
    landmarks = _indices(shape_path, shape["keypoints"], "keypoints", len(mean)).ravel()
    return StoredModel(
        name="BFM 2009 (300W-LP)",
        licence="Basel Face Model: registration with the University of Basel, research only; not to be passed on",
        origin="Paysan et al. 2009, expressions of Cao et al. 2014 as in Zhu et al. 2016",
        mean=mean,
        identity_basis=identity,
        expression_basis=deformation,
        polygons=np.column_stack([wound_outward(mean, triangles), np.full(len(triangles), -1, np.int32)]),
        polygon_regions=np.zeros(len(triangles), np.uint8),
        region_names=("skin",),
        face_regions=("skin",),
        landmarks={IBUG68: landmarks},
        published_basis=PUBLISHED_BASIS,
        identity_unit=identity_unit,
        expression_unit=expression_unit,
    )


def wound_outward(vertices: ndarray, triangles: Int32[ndarray, "t 3"]) -> Int32[ndarray, "t 3"]:
    """Swaps two corners of every triangle where most of them face the inside of the head."""
    corners = vertices[triangles].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # The origin is inside the head, so an outward normal points away from it.
    outward = np.einsum("tc,tc->t", normals, corners.mean(axis=1)) > 0
    return triangles if outward.mean() > 0.5 else np.ascontiguousarray(triangles[:, [0, 2, 1]])


def _read(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    try:
        fields = scipy.io.loadmat(path, variable_names=list(names))
    except Exception as error:
        raise InputFileError(
            f"{path}: expected a MAT 5 file, found one that cannot be read ({type(error).__name__}: {error})"
        ) from error
    missing = [name for name in names if name not in fields]
    if missing:
        found = [name for name in fields if not name.startswith("__")]
        raise InputFileError(
            f"{path}: expected {', '.join(names)} in it, missing are {', '.join(missing)}; found {found}"
        )
    return fields


def _column(path: Path, fields: dict[str, Any], name: str) -> Float64[ndarray, " n"]:
    values = np.asarray(fields[name], dtype=np.float64).ravel()
    if not len(values) or len(values) % 3 or not np.isfinite(values).all():
        raise InputFileError(f"{path}: expected 3 finite coordinates a vertex in {name}, found {len(values)} numbers")
    return values


def _basis(path: Path, components: Any, deviations: Any, n: int) -> tuple[ndarray, Float64[ndarray, " k"]]:
    """Scales components to one standard deviation in mm."""
    unit = np.asarray(deviations, dtype=np.float64).ravel()
    if np.shape(components) != (n, len(unit)):
        raise InputFileError(
            f"{path}: expected a basis of {n} rows and {len(unit)} columns (one for each standard deviation), "
            f"found {np.shape(components)}"
        )
    scaled = np.asarray(components, dtype=np.float32) * (unit * MM_PER_UM).astype(np.float32)
    return np.ascontiguousarray(scaled.T).reshape(len(unit), -1, 3), unit


def _indices(path: Path, values: Any, name: str, n_vertices: int) -> Int32[ndarray, "..."]:
    indices = np.asarray(values).astype(np.int64) - 1  # Matlab counts from 1
    if indices.min(initial=0) < 0 or indices.max(initial=0) >= n_vertices:
        raise InputFileError(f"{path}: expected vertices 1 to {n_vertices} in {name}, found others")
    return indices.astype(np.int32)
