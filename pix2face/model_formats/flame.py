"""FLAME 2020 and 2023 (``generic_model.pkl``, ``flame2023.pkl``): shape and expression, joints at rest.

``v_template`` (v, 3), ``f``, and ``shapedirs`` (v, 3, 400): 300 identity and 100 expression components, already at one
standard deviation, in metres. Pose blend shapes and joints are not read. No copy was at hand: the reader is tested on
files of ours in this layout.

Source: Li et al. 2017, Learning a model of facial shape and expression from 4D scans.
"""

from pathlib import Path

import numpy as np

from pix2face.errors import InputFileError
from pix2face.model_formats.checks import MM_PER_METRE, basis_of_columns, check_names, coordinates, triangle_polygons
from pix2face.model_formats.pickled_arrays import as_array
from pix2face.model_formats.restricted_pickle import read_pickle
from pix2face.models.model_file import StoredModel

N_IDENTITY, N_EXPRESSION = 300, 100


def read_flame(path: Path) -> StoredModel:
    """Reads the model, in mm, in its own frame (x to the subject's left, y up, z out of the face).

    Raises:
        InputFileError: Missing, truncated or foreign file, a pickle that asks for anything but arrays, or arrays that
            do not fit each other.
    """
    fields = read_pickle(path)
    check_names(path, ("v_template", "f", "shapedirs"), fields)
    mean = coordinates(f"{path} (v_template)", as_array(fields["v_template"], f"{path} (v_template)")) * MM_PER_METRE
    directions = as_array(fields["shapedirs"], f"{path} (shapedirs)")
    n_components = N_IDENTITY + N_EXPRESSION
    if directions.shape != (len(mean), 3, n_components):
        raise InputFileError(
            f"{path}: expected shapedirs of ({len(mean)}, 3, {n_components}): {N_IDENTITY} identity and {N_EXPRESSION} "
            f"expression components, found {directions.shape}"
        )
    columns = directions.reshape(-1, n_components)
    basis = basis_of_columns(f"{path} (shapedirs)", columns, None, len(mean), MM_PER_METRE)
    polygons = triangle_polygons(f"{path} (f)", as_array(fields["f"], f"{path} (f)"), len(mean))
    return StoredModel(
        name=f"FLAME ({path.stem})",
        licence="FLAME: registration with the Max Planck Institute for Intelligent Systems; 2020: non-commercial "
        "research; 2023 Open: CC-BY-4.0",
        origin=f"Li et al. 2017, {path.name}; joints at rest",
        mean=mean.astype(np.float32),
        identity_basis=np.ascontiguousarray(basis[:N_IDENTITY]),
        expression_basis=np.ascontiguousarray(basis[N_IDENTITY:]),
        polygons=polygons,
        polygon_regions=np.zeros(len(polygons), np.uint8),
    )
