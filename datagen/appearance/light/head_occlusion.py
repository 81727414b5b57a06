"""How much ambient light arrives at each vertex of the built-in model: made by ``scripts/build_head_occlusion.py``."""

from importlib.resources import as_file, files

import h5py
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from pix2face.models.morphable_model import MorphableModel


def head_occlusion(model: MorphableModel) -> Float32[ndarray, " v"]:
    """1 where a vertex is open to all directions on its outside, 0 where it is closed in.

    Known for the built-in model; for others the light is taken to arrive everywhere. The inside of the mouth is as in
    an open one: in a closed one nobody sees it.
    """
    with (
        as_file(files("datagen") / "assets" / "head_occlusion.h5") as path,
        h5py.File(path, "r", locking=False) as file,
    ):
        stored = file["occlusion"][:]
        is_same = file.attrs["model_sha256"] == model.sha256 and len(stored) == len(model.mean)
    if not is_same:
        return np.ones(len(model.mean), dtype=np.float32)
    return np.asarray(stored.astype(np.float32) / 255)
