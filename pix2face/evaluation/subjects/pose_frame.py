"""Which way a face looks that looks straight ahead: benchmarks say it of one morphable model, fits of another.

Poses of 300W-LP and AFLW2000-3D are those of the mean face of BFM 2009. Laid onto the built-in model's mean face by
their 68 landmarks, BFM's is turned by 4.4° about x (``python -m scripts.measure_correspondence`` prints it). So a face
of the same photograph has another pitch for each.
"""

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from pix2face.evaluation.benchmarks.manifest import Manifest
from pix2face.models.morphable_model import MorphableModel, builtin_model

BFM_IN_BUILTIN_DEG = 4.4


def model_from_stated(model: MorphableModel, manifest: Manifest) -> Float64[ndarray, "3 3"]:
    """Rotation to a model's frame from that in which a benchmark states poses.

    None for the benchmarks of our own renders, and for imported models, which keep the frame that they were published
    in: that of BFM itself, for which the figures are meant.
    """
    if manifest.kind == "shards" or model.sha256 != builtin_model().sha256:
        return np.eye(3)
    return np.asarray(Rotation.from_euler("x", BFM_IN_BUILTIN_DEG, degrees=True).as_matrix(), dtype=np.float64)
