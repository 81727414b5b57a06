"""Basel Face Model 2009 as programs for reconstruction keep it, trimmed, with expressions and landmarks in one file.

``BFM_model_front.mat`` of Deep3DFaceReconstruction: 35,709 vertices in dm, ``meanshape``, and ``idBase`` and ``exBase``
that are multiplied by their deviations already.

Source: Deng et al. 2019, Accurate 3D Face Reconstruction with Weakly-Supervised Learning.
"""

from pathlib import Path

import numpy as np

from pix2face.errors import InputFileError
from pix2face.files.mat_files import mat_names, read_mat
from pix2face.geometry.landmarks import IBUG68, N_IBUG68
from pix2face.model_formats.bfm2009 import LICENCE, albedo_of_255
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
MM_PER_DM = 100.0
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
    identity, expression = (
        basis_of_columns(f"{path} ({name})", fields[name], None, n_vertices, MM_PER_DM) for name in ("idBase", "exBase")
    )
    keypoints = vertex_numbers(f"{path} (keypoints)", fields["keypoints"].ravel(), n_vertices, first=1)
    if len(keypoints) != N_IBUG68:
        raise InputFileError(f"{path}: expected {N_IBUG68} keypoints, found {len(keypoints)}")
    polygons = triangle_polygons(f"{path} (tri)", fields["tri"], n_vertices, first=1)
    ones = np.ones(fields["texBase"].shape[-1]) if "texBase" in fields else None
    return StoredModel(
        name="BFM 2009 (front)",
        licence=LICENCE,
        origin=f"Paysan et al. 2009, expressions as in Deng et al. 2019, {path.name}",
        mean=mean.astype(np.float32),
        identity_basis=identity,
        expression_basis=expression,
        polygons=wound_outward(mean, polygons),
        polygon_regions=np.zeros(len(polygons), np.uint8),
        landmarks={IBUG68: keypoints},
        published_basis=FRONT_BASIS,
        **albedo_of_255(path, fields.get("meantex"), fields.get("texBase"), ones, n_vertices),
    )
