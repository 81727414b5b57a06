"""Brows and lashes, which move with the face."""

from dataclasses import dataclass
from functools import cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32
from numpy import ndarray

from datagen.appearance.asset_files import read_picture
from datagen.appearance.hair.bound_meshes import BoundMesh, bound_mesh, brow_patch
from datagen.appearance.hair.hair_colour import HairColour, brow_colour
from datagen.appearance.hair.hair_config import HairConfig
from datagen.appearance.hair.styles import UNCUT_MM
from datagen.appearance.person import Person
from datagen.appearance.scene import Colour, Material, PosedHead, SceneMesh
from datagen.appearance.solids import cross
from datagen.random_streams import rounded
from pix2face.models.morphable_model import MorphableModel

N_BROWS = 12
LASH_STYLES = ("eyelashes01", "eyelashes02", "eyelashes03", "eyelashes04")
# Length of one unit of the brows' v coordinate (scripts/hair_assets/brow_patch.py).
BROW_V_MM = 36.0
# Largest shift of brows in pixels of their textures (4 per mm), and smallest alpha of hair.
MOVES_PX, HAIRY = 9, 24
EYE_REGIONS = ("eyes", "iris", "pupil")
INK = (0.008, 0.007, 0.007)


@final
@dataclass(frozen=True, kw_only=True)
class Brows:
    """Brows of a face."""

    layer: int  # index of one of the twelve brows
    colour: Colour  # linear
    alpha: float  # 0 without brows, 1 as painted
    density: float  # 1 as painted
    thickness: float  # factor on their height
    shift_mm: float  # shift of both brows, upward
    apart_mm: float  # shift of each brow away from the middle; negative values join them
    uneven_mm: float  # height of the subject's left brow above the right one


@final
@dataclass(frozen=True, kw_only=True)
class Lashes:
    """Lashes of a face."""

    layer: int  # index into `LASH_STYLES`
    colour: Colour  # linear
    alpha: float  # 0 is invisible, 1 full
    length: float  # factor on the length
    has_mascara: bool


def draw_brows(rng: np.random.Generator, config: HairConfig, person: Person, hair: HairColour) -> Brows:
    """Draws brows, which are thicker for men and fainter for old people."""
    kind = rng.random()
    is_joined = kind < config.joined_brows_share * (1.5 - person.femininity)
    thickness = rng.uniform(*config.brow_thickness) * (1.12 - 0.24 * person.femininity)
    age = np.clip((person.age_years - 45) / 40, 0, 1)
    return Brows(
        layer=int(rng.integers(N_BROWS)),
        colour=brow_colour(rng, config, hair),
        alpha=0.0 if kind > 1 - config.no_brows_share else rounded(rng.uniform(0.75, 1) * (1 - 0.25 * age)),
        density=rounded(rng.uniform(*config.brow_density)),
        thickness=rounded(thickness),
        shift_mm=rounded(np.clip(rng.normal(0, config.brow_shift_mm), -2.5, 4), 2),
        apart_mm=rounded(rng.uniform(-9, -5) if is_joined else rng.normal(0, 1), 2),
        uneven_mm=rounded(rng.normal(0, 0.4), 2),
    )


def draw_lashes(rng: np.random.Generator, config: HairConfig, person: Person, brow: Colour) -> Lashes:
    """Draws lashes. Many are hardly visible; mascara makes them black and long."""
    share = config.mascara_share * (person.femininity + 0.05 * (1 - person.femininity))
    has_mascara = bool(rng.random() < share)
    return Lashes(
        layer=int(rng.integers(len(LASH_STYLES))),
        colour=INK if has_mascara else brow,
        alpha=rounded(rng.uniform(0.7, 1) if has_mascara else rng.uniform(0.15, 0.7)),
        length=rounded(rng.uniform(0.85, 1.15) if has_mascara else rng.uniform(0.5, 0.95)),
        has_mascara=has_mascara,
    )


def brow_mesh(brows: Brows, head: PosedHead) -> SceneMesh:
    """Makes the mesh of both brows from the skin below them, lifted by 0.8 mm."""
    vertices, triangles, uv = _both_patches(head.model)
    n = len(vertices) // 2
    u, v = uv[:, 0] - brows.apart_mm / 60.0, uv[:, 1].copy()
    v[:n] += (brows.shift_mm + brows.uneven_mm / 2) / BROW_V_MM
    v[n:] += (brows.shift_mm - brows.uneven_mm / 2) / BROW_V_MM
    ridge = _ridges()[brows.layer]
    middle = np.interp(u, np.linspace(0, 1, len(ridge)), ridge)
    placed = np.column_stack([u, middle + (v - middle) / brows.thickness])
    return SceneMesh(
        name=f"brows/{brows.layer + 1}",
        label="head",
        vertices=head.vertices[vertices] + np.float32(0.8) * head.normals[vertices],
        triangles=triangles,
        uv=placed.astype(np.float32),
        normals=head.normals[vertices],
        material=_material("hair_brows", brows, brows.density),
        casts_shadow=False,
    )


def lash_mesh(lashes: Lashes, head: PosedHead) -> SceneMesh:
    """Makes the mesh of all lashes. Roots follow the lids, and lashes rotate with them about the eyeball."""
    mesh = bound_mesh(LASH_STYLES[lashes.layer])
    points = turned_with_lids(mesh, head, lashes.length)
    return SceneMesh(
        name=f"lashes/{mesh.name}",
        label="head",
        vertices=points[mesh.point_of_vertex],
        triangles=mesh.triangles,
        uv=mesh.uv,
        normals=mesh.normals[mesh.point_of_vertex],
        material=_material("hair_lashes", lashes, 1.0),
        casts_shadow=False,
    )


def _material(texture: str, hair: Brows | Lashes, density: float) -> Material:
    return Material(
        kind="hair",
        texture=texture,
        layer=hair.layer,
        colour=hair.colour,
        alpha=hair.alpha,
        numbers=(1.0, density, UNCUT_MM, 0.0),
        is_blended=True,
    )


def turned_with_lids(mesh: BoundMesh, head: PosedHead, length: float) -> Float32[ndarray, "p 3"]:
    """Returns the points of lashes, whose offsets rotate as their roots do about the centre of the eye."""
    is_left = mesh.feet[:, :1] > 0
    before, after = (
        np.where(is_left, *(vertices[eye].mean(axis=0).astype(np.float32) for eye in _eye_vertices(head.model)))
        for vertices in (head.model.mean, head.vertices)
    )
    roots = mesh.feet + mesh.displacements(head.vertices, head.model.mean)
    turned = turn_between(mesh.feet - before, roots - after, (mesh.mean - mesh.feet) * np.float32(length))
    return (roots + turned).astype(np.float32)


def turn_between(
    before: Float32[ndarray, "n 3"], after: Float32[ndarray, "n 3"], vectors: Float32[ndarray, "n 3"]
) -> Float32[ndarray, "n 3"]:
    """Rotates each vector by the smallest rotation from one direction to another, which must not be opposite.

    Source: Rodrigues' formula, with the axis before x after.
    """
    a, b = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (before, after))
    axis, cosine = cross(a, b), (a * b).sum(axis=1, keepdims=True)
    along = (axis * vectors).sum(axis=1, keepdims=True) / np.maximum(1 + cosine, 1e-6)
    return (vectors * cosine + cross(axis, vectors) + axis * along).astype(np.float32)


@cache
def _both_patches(model: MorphableModel) -> tuple[Int32[ndarray, " n"], Int32[ndarray, "t 3"], Float32[ndarray, "n 2"]]:
    """Returns vertices, triangles and texture coordinates of the left patch and its mirror image."""
    assert model.symmetry is not None
    patch = brow_patch()
    vertices, triangles = patch["vertices"].astype(np.int32), patch["triangles"].astype(np.int32)
    triangles = triangles[_is_hairy(patch["uv"])[triangles].any(axis=1)]
    both = np.concatenate([vertices, model.symmetry[vertices]]).astype(np.int32)
    right = triangles[:, [0, 2, 1]] + np.int32(len(vertices))
    uv = patch["uv"].astype(np.float32)
    return both, np.concatenate([triangles, right]), np.concatenate([uv, uv])


def _is_hairy(uv: Float32[ndarray, "n 2"]) -> Bool[ndarray, " n"]:
    """Whether a brow, shifted by up to `MOVES_PX`, can cover each place of the patch."""
    reached = cv2.dilate(brow_pictures()[..., 1].max(axis=0), np.ones((2 * MOVES_PX + 1,) * 2, np.uint8)) > HAIRY
    rows, columns = reached.shape
    row, column = np.clip(uv[:, 1] * rows, 0, rows - 1), np.clip(uv[:, 0] * columns, 0, columns - 1)
    return reached[row.astype(int), column.astype(int)]


@cache
def brow_pictures() -> ndarray:
    """Reads the twelve brows: bytes of shape (12, rows, columns, 2), grey and alpha."""
    stacked = read_picture("hair/brows.webp")[..., [0, 3]]
    return stacked.reshape(N_BROWS, -1, *stacked.shape[1:])


@cache
def _ridges() -> Float64[ndarray, "n w"]:
    """Returns the v coordinate of the middle of each brow along u, constant beyond its ends."""
    alpha = brow_pictures()[..., 1].astype(np.float64)
    total = alpha.sum(axis=1)
    rows = (np.arange(alpha.shape[1]) + 0.5) / alpha.shape[1]
    columns = np.arange(alpha.shape[2])
    ridges = []
    for layer, weight in zip(alpha, total, strict=True):
        known = weight > 0.1 * weight.max()
        middle = (rows @ layer)[known] / weight[known]
        smooth = np.convolve(np.pad(middle, 8, "edge"), np.full(17, 1 / 17), "valid")
        ridges.append(np.interp(columns, columns[known], smooth))
    return np.array(ridges)


@cache
def _eye_vertices(model: MorphableModel) -> tuple[ndarray, ndarray]:
    vertices = model.vertices_of(*EYE_REGIONS)
    is_left = model.mean[vertices, 0] > 0
    return vertices[is_left], vertices[~is_left]
