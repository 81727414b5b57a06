"""A small head without files: an ellipsoid with a nose and ears, open at the neck, with smooth random bases.

It has what the code under test relies on (frame, units, winding, regions, exact mirror symmetry, 68 landmarks) and
nothing else of a face.
"""

from functools import lru_cache

import numpy as np
import trimesh
from jaxtyping import Float, Float32, Int32, UInt8
from numpy import ndarray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

from pix2face.models.morphable_model import MorphableModel

REGION_NAMES = ("skin", "lips", "eyes", "ears", "brows", "scalp", "neck")
FACE_REGIONS = ("skin", "lips", "eyes", "ears", "brows")
SEMI_AXES_MM = np.array([76.0, 112.0, 98.0])
EYE_CENTRE_MM = np.array([32.0, 25.0])
MOUTH_CENTRE_MM = np.array([0.0, -52.0])


@lru_cache(maxsize=1)
def small_head_model() -> MorphableModel:
    """A head of some 2,400 vertices, 12 identity and 6 expression components, and the 68 landmarks."""
    vertices, triangles = _head()
    symmetry = KDTree(vertices).query(vertices * [-1, 1, 1])[1].astype(np.int32)
    mean = (0.5 * (vertices + vertices[symmetry] * [-1, 1, 1])).astype(np.float32)
    lower_face = 1 / (1 + np.exp((mean[:, 1] + 20) / 8)) / (1 + np.exp(-(mean[:, 2] - 20) / 10))
    rng = np.random.default_rng(20170101)
    return MorphableModel(
        name="small synthetic head",
        licence="CC0-1.0",
        origin="tests/synthetic_models.py",
        sha256="0" * 64,
        mean=mean,
        identity_basis=_smooth_basis(rng, mean, 12, amplitude_mm=2.5),
        expression_basis=_smooth_basis(rng, mean, 6, amplitude_mm=3) * lower_face[:, None].astype(np.float32),
        triangles=triangles,
        triangle_regions=_regions(mean[triangles].mean(axis=1)),
        region_names=REGION_NAMES,
        face_regions=FACE_REGIONS,
        landmarks={"ibug68": _landmarks(mean, symmetry)},
        uv=None,
        uv_triangles=None,
        symmetry=symmetry,
        named_expressions={
            "neutral": np.zeros(6, dtype=np.float32),
            "jawOpen": np.array([2, 0, 0, 0, 0, 0], dtype=np.float32),
            "smile": np.array([0, 1, -1, 0, 0, 0], dtype=np.float32),
        },
    )


def _head() -> tuple[Float[ndarray, "v 3"], Int32[ndarray, "t 3"]]:
    sphere = trimesh.creation.icosphere(subdivisions=4)
    kept = sphere.triangles_center[:, 1] > -0.7 - 0.8 * np.maximum(sphere.triangles_center[:, 2], 0)
    used, triangles = np.unique(sphere.faces[kept], return_inverse=True)
    vertices = sphere.vertices[used] * SEMI_AXES_MM
    x, y, z = vertices.T
    nose = np.exp(-((x / 10) ** 2) - ((y + 8) / 18) ** 2) * (z > 0)
    ear = np.exp(-(((y - 8) / 16) ** 2) - ((z + 5) / 10) ** 2)
    bumps = np.stack([16 * ear * np.sign(x), 0 * x, 24 * nose - 5 * ear], axis=1)
    return vertices + bumps, triangles.reshape(-1, 3).astype(np.int32)


def _regions(centres: Float[ndarray, "t 3"]) -> UInt8[ndarray, " t"]:
    x, y, z = np.abs(centres[:, 0]), centres[:, 1], centres[:, 2]
    regions = np.full(len(centres), REGION_NAMES.index("skin"), dtype=np.uint8)
    regions[(x - 32) ** 2 / 24**2 + (y - 44) ** 2 / 6**2 < 1] = REGION_NAMES.index("brows")
    regions[(x - EYE_CENTRE_MM[0]) ** 2 / 15**2 + (y - EYE_CENTRE_MM[1]) ** 2 / 9**2 < 1] = REGION_NAMES.index("eyes")
    regions[x**2 / 26**2 + (y - MOUTH_CENTRE_MM[1]) ** 2 / 12**2 < 1] = REGION_NAMES.index("lips")
    regions[(z < -12) | (y > 65 + 0.2 * z)] = REGION_NAMES.index("scalp")
    regions[(x > 70) & (np.abs(y - 8) < 26) & (z > -26)] = REGION_NAMES.index("ears")
    regions[(y < -40) & (z < 0)] = REGION_NAMES.index("neck")
    return regions


def _smooth_basis(
    rng: np.random.Generator, points: Float32[ndarray, "v 3"], count: int, amplitude_mm: float
) -> Float32[ndarray, "k v 3"]:
    """Displacements that are waves of 0.2 to 0.4 m: no folds, no two components alike."""
    waves = rng.normal(size=(count, 3, 3)) / 45
    phases = rng.uniform(0, 2 * np.pi, size=(count, 1, 3))
    return (amplitude_mm * np.sin(np.einsum("vi,kic->kvc", points, waves) + phases)).astype(np.float32)


def _landmarks(mean: Float32[ndarray, "v 3"], symmetry: Int32[ndarray, " v"]) -> Int32[ndarray, "68"]:
    """Distinct vertices near a drawn layout; the subject's right half is chosen, the left mirrors it."""
    right, middle, mirror = _layout()
    landmarks = np.full(68, -1, dtype=np.int32)
    on_axis = symmetry == np.arange(len(mean))
    for targets, allowed in ((middle, on_axis), (right, mean[:, 0] < -1)):
        candidates = np.flatnonzero(allowed & (mean[:, 2] > -12))
        cost = np.stack([_squared_distance(target, mean[candidates]) for target in targets.values()])
        landmarks[list(targets)] = candidates[linear_sum_assignment(cost)[1]]
    for index, twin in mirror.items():
        landmarks[twin] = symmetry[landmarks[index]]
    return landmarks


def _squared_distance(target: Float[ndarray, "3"], points: Float32[ndarray, "n 3"]) -> Float[ndarray, " n"]:
    """Distance to a target whose z is NaN where only the front view counts."""
    distance = (points - np.nan_to_num(target)) ** 2
    if np.isnan(target[2]):
        return distance[:, :2].sum(axis=1) + 1e4 * (points[:, 2] < 0)
    return np.asarray(distance.sum(axis=1))


def _layout() -> tuple[dict[int, ndarray], dict[int, ndarray], dict[int, int]]:
    """Target points (mm) of the subject's right half and of the middle line, and the mirror twins."""
    right: dict[int, ndarray] = {}
    middle: dict[int, ndarray] = {}
    for i, t in enumerate(np.linspace(0, np.pi / 2, 9)):
        right[i] = np.array([-76 * np.cos(t), 5 - 100 * np.sin(t), 65 * np.sin(t) + 5])
    middle[8] = right.pop(8)
    for i in range(5):
        right[17 + i] = np.array([-58 + 11 * i, 42 + 3 * np.sin(i), np.nan])
    middle |= {27 + i: np.array([0, 25 - 12 * i, np.nan]) for i in range(4)}
    right |= {31: np.array([-16, -24, np.nan]), 32: np.array([-8, -27, np.nan])}
    middle[33] = np.array([0, -28, np.nan])
    for i, angle in enumerate(np.deg2rad([180, 120, 60, 0, -60, -120])):
        ellipse = np.array([14 * np.cos(angle), 7 * np.sin(angle)])
        right[36 + i] = np.append(EYE_CENTRE_MM * [-1, 1] + ellipse, np.nan)
    outer = {48 + i: (26, 14, 180 - 30 * i) for i in range(12)}
    inner = {60 + i: (17, 5, 180 - 45 * i) for i in range(8)}
    for i, (width, height, angle_deg) in (outer | inner).items():
        offset = np.array([width * np.cos(np.deg2rad(angle_deg)), height * np.sin(np.deg2rad(angle_deg))])
        if offset[0] < 1e-6:
            side = middle if offset[0] > -1e-6 else right
            side[i] = np.append(MOUTH_CENTRE_MM + offset, np.nan)
    mirror = {i: 16 - i for i in range(8)} | {17 + i: 26 - i for i in range(5)} | {31: 35, 32: 34}
    mirror |= {36: 45, 37: 44, 38: 43, 39: 42, 40: 47, 41: 46, 48: 54, 49: 53, 50: 52, 59: 55, 58: 56}
    mirror |= {60: 64, 61: 63, 67: 65}
    return right, middle, mirror
