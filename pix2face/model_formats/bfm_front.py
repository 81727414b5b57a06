"""Basel Face Model 2009 as programs for reconstruction keep it, trimmed, with expressions and landmarks in one file.

``BFM_model_front.mat`` of Deep3DFaceReconstruction: 35,709 vertices in dm, ``meanshape``, and ``idBase`` and ``exBase``
that are multiplied by their deviations already.

Source: Deng et al. 2019, Accurate 3D Face Reconstruction with Weakly-Supervised Learning.
"""

from pathlib import Path
from typing import Any

import numpy as np

from pix2face.errors import InputFileError
from pix2face.files.mat_files import mat_names, read_mat
from pix2face.geometry.landmarks import IBUG68, N_IBUG68
from pix2face.model_formats.bfm2009 import LICENCE
from pix2face.model_formats.checks import (
    basis_of_columns,
    check_names,
    coordinates,
    triangle_polygons,
    vertex_numbers,
    wound_outward,
)
from pix2face.models.model_file import StoredModel

FRONT_NAMES = ("meanshape", "idBase", "exBase", "tri", "keypoints")
MM_PER_DM, ALBEDO_LEVELS = 100.0, 255.0
FRONT_BASIS = "bfm2009-front"


def is_bfm_front(path: Path) -> bool:
    """Whether a MAT file is the model's."""
    return {"meanshape", "idBase"} <= set(mat_names(path))


def read_bfm_front(path: Path) -> StoredModel:
    """Reads the model, in mm, in the frame of BFM 2009.

    Raises:
        InputFileError: The file is damaged, or its arrays do not fit each other.
    """
    check_names(path, FRONT_NAMES, mat_names(path))
    fields = read_mat(path, (*FRONT_NAMES, "meantex", "texBase"))
    mean = coordinates(f"{path} (meanshape)", fields["meanshape"]) * MM_PER_DM
    n_vertices = len(mean)
    bases = {}
    for name in ("idBase", "exBase"):
        columns = fields[name]
        deviations = np.ones(columns.shape[-1])
        bases[name] = basis_of_columns(f"{path} ({name})", columns, deviations, n_vertices, MM_PER_DM)
    keypoints = vertex_numbers(f"{path} (keypoints)", fields["keypoints"].ravel(), n_vertices, first=1)
    if len(keypoints) != N_IBUG68:
        raise InputFileError(f"{path}: expected {N_IBUG68} keypoints, found {len(keypoints)}")
    polygons = triangle_polygons(f"{path} (tri)", fields["tri"], n_vertices, first=1)
    albedo: dict[str, Any] = {}
    if "meantex" in fields and "texBase" in fields:
        colours, columns = coordinates(f"{path} (meantex)", fields["meantex"]), fields["texBase"]
        ones = np.ones(columns.shape[-1])
        albedo = {
            "albedo_mean": (colours / ALBEDO_LEVELS).astype(np.float32),
            "albedo_basis": basis_of_columns(f"{path} (texBase)", columns, ones, n_vertices, 1 / ALBEDO_LEVELS),
        }
    return StoredModel(
        name="BFM 2009 (front)",
        licence=LICENCE,
        origin=f"Paysan et al. 2009, expressions as in Deng et al. 2019, {path.name}",
        mean=mean.astype(np.float32),
        identity_basis=bases["idBase"],
        expression_basis=bases["exBase"],
        polygons=wound_outward(mean, polygons),
        polygon_regions=np.zeros(len(polygons), np.uint8),
        landmarks={IBUG68: keypoints},
        published_basis=FRONT_BASIS,
        **albedo,
    )
