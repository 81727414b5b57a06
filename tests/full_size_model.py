"""A stand-in of BFM 2009's size: the built-in head one step finer, cut to 53,215 vertices, 199 + 29 components."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from pix2face.models.morphable_model import MorphableModel, builtin_model

N_VERTICES, N_IDENTITY, N_EXPRESSION = 53_215, 199, 29
REFINEMENT_STEPS = 2  # one more than the built-in model has


@lru_cache(maxsize=1)
def full_size_model() -> MorphableModel:
    """The built-in components, and smooth waves with falling amplitudes for the identities that it lacks."""
    fine = builtin_model(REFINEMENT_STEPS)
    # What is cut off lies at the back; all of the face stays.
    order = np.argsort(-(fine.mean[:, 2] + 1000 * fine.is_face_vertex), kind="stable")
    kept = np.sort(order[:N_VERTICES])
    assert np.isin(np.concatenate(list(fine.landmarks.values())), kept).all()
    new_index = np.full(len(fine.mean), -1, dtype=np.int32)
    new_index[kept] = np.arange(N_VERTICES, dtype=np.int32)
    whole = (new_index[fine.triangles] >= 0).all(axis=1)
    mean = fine.mean[kept]
    waves = _waves(mean, N_IDENTITY - fine.n_identity)
    return MorphableModel(
        name="stand-in of BFM's size",
        licence="CC0-1.0",
        origin="tests/full_size_model.py",
        sha256="f" * 64,
        mean=mean,
        identity_basis=np.ascontiguousarray(np.concatenate([fine.identity_basis[:, kept], waves])),
        expression_basis=np.ascontiguousarray(fine.expression_basis[:N_EXPRESSION, kept]),
        triangles=new_index[fine.triangles[whole]],
        triangle_regions=fine.triangle_regions[whole],
        region_names=fine.region_names,
        face_regions=fine.face_regions,
        landmarks={name: new_index[vertices] for name, vertices in fine.landmarks.items()},
        uv=None,
        uv_triangles=None,
        symmetry=None,
        named_expressions={},
    )


def _waves(mean: Float32[ndarray, "v 3"], count: int) -> Float32[ndarray, "k v 3"]:
    """Displacements of 0.4 down to 0.05 mm, waves of 6 to 30 cm."""
    rng = np.random.default_rng(2009)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lengths_mm = rng.uniform(60, 300, size=count)
    phase = mean @ (directions * (2 * np.pi / lengths_mm)[:, None]).T + rng.uniform(0, 2 * np.pi, count)
    amplitudes = np.geomspace(0.4, 0.05, count)[:, None] * rng.normal(size=(count, 3))
    return (np.sin(phase).T[:, :, None] * amplitudes[:, None, :]).astype(np.float32)
