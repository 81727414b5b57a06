"""Beards and moustaches: shells of strands over the lower face that follow its expression; lips stay free."""

from dataclasses import dataclass
from functools import lru_cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from datagen.appearance.accessories.beards.beard_texture import (
    BEARD_STRANDS,
    COLUMNS,
    LEVELS,
    ROWS,
    STYLES,
    beard_anchors,
    beard_layer,
    beard_textures,
    style_densities,
)
from datagen.appearance.accessories.colours import Colour
from datagen.appearance.person import Person
from datagen.appearance.scene import Material, PosedHead, SceneMesh
from datagen.appearance.solids import grid_triangles, scene_mesh, solid, unit

__all__ = ["Beard", "beard_meshes", "beard_textures", "draw_beard"]

_WEIGHTS = (0.30, 0.20, 0.14, 0.07, 0.14, 0.05, 0.04, 0.03, 0.03)
SKIN_GAP_MM = 0.4


@final
@dataclass(frozen=True, kw_only=True)
class Beard:
    """A beard.

    Attributes:
        style: One of ``beard_texture.STYLES``.
        thickness_mm: How far it stands out from the skin.
        hang_mm: How far its tips hang down at the chin.
        density: Of its strands, 1 is dense.
        greyness: 0 the colour of the hair, 1 white.
        darkening: Factor on the colour of the hair.
    """

    style: str
    thickness_mm: float
    hang_mm: float
    density: float
    greyness: float
    darkening: float


def draw_beard(rng: np.random.Generator, person: Person) -> Beard:
    """Draws a beard: mostly short, now and then a long one; grey comes with age, earlier than in the hair."""
    style = str(rng.choice(STYLES, p=np.array(_WEIGHTS) / sum(_WEIGHTS)))
    is_long = style in ("full", "chin", "goatee") and rng.uniform() < 0.22
    thickness = rng.uniform(7, 15) if is_long else rng.uniform(1.2, 6.0)
    old = 1 / (1 + np.exp(-(person.age_years - 55) / 7))
    return Beard(
        style=style,
        thickness_mm=round(float(thickness), 2),
        hang_mm=round(float(rng.gamma(2, 14) + 8), 2) if is_long else round(float(rng.uniform(0, 3)), 2),
        density=round(float(np.clip(rng.normal(1.0, 0.18), 0.5, 1.3)), 3),
        greyness=round(float(np.clip(rng.normal(1.2 * old - 0.15, 0.2), 0, 1)), 3),
        darkening=round(float(rng.uniform(0.65, 1.1)), 3),
    )


def beard_meshes(beard: Beard, head: PosedHead, hair_rgb: Colour) -> list[SceneMesh]:
    """The shells, from the skin outward.

    Args:
        beard: What was drawn.
        head: With its expression.
        hair_rgb: Of the hair, linear.
    """
    anchors = beard_anchors(head.model)
    skin, normals = anchors.at(head.vertices), unit(anchors.at(head.normals))
    reach, hang = _growth(beard.style)
    triangles = _grown_triangles(beard.style)
    count = 3 if beard.thickness_mm < 2.5 else 4 if beard.thickness_mm < 6 else 6
    colour = np.asarray(hair_rgb) * beard.darkening * (1 - beard.greyness) + beard.greyness * np.array([0.5, 0.5, 0.49])
    red, green, blue = (round(float(part), 5) for part in np.clip(colour, 0, 1))
    meshes = []
    for shell, share in enumerate(np.linspace(0, 1, count)):
        out = SKIN_GAP_MM + share * beard.thickness_mm * reach
        down = share**1.3 * beard.hang_mm * hang
        points = skin + out[:, None] * normals + down[:, None] * np.array([0.0, -1.0, 0.12], dtype=np.float32)
        level = min(int(share * LEVELS), LEVELS - 1)
        material = Material(
            kind="hair",
            texture=BEARD_STRANDS,
            layer=beard_layer(beard.style, level),
            colour=(red, green, blue),
            roughness=0.5,
            numbers=(1.0, beard.density, -1e3, 0.0),
            is_blended=True,
        )
        made = solid(points, triangles, _uv(), normals)
        meshes.append(scene_mesh(f"beard/{beard.style}{shell}", "beard", made, material, casts_shadow=shell == 0))
    return meshes


@lru_cache(maxsize=1)
def _uv() -> Float32[ndarray, "v 2"]:
    u, v = np.meshgrid(np.linspace(0, 1, COLUMNS, dtype=np.float32), np.linspace(0, 1, ROWS, dtype=np.float32))
    return np.stack([u, v], axis=-1).reshape(-1, 2)


@lru_cache(maxsize=16)
def _growth(style: str) -> tuple[Float32[ndarray, " v"], Float32[ndarray, " v"]]:
    """At each point of the grid: share of the thickness (thin at the border), share of the hanging."""
    soft = cv2.GaussianBlur(style_densities()[style], (0, 0), 6.0)
    reach = np.clip(cv2.resize(soft, (COLUMNS, ROWS), interpolation=cv2.INTER_LINEAR).reshape(-1) * 1.3 - 0.1, 0, 1)
    uv = _uv()
    around = np.abs(uv[:, 0] - 0.5) * 2
    hang = np.clip((uv[:, 1] - 0.55) / 0.25, 0, 1) * np.clip(1 - around / 0.75, 0, 1) * reach
    return np.asarray(reach, dtype=np.float32), np.asarray(hang, dtype=np.float32)


@lru_cache(maxsize=16)
def _grown_triangles(style: str) -> Int32[ndarray, "t 3"]:
    """Triangles where anything grows."""
    wide = cv2.dilate(style_densities()[style], np.ones((3, 3)))
    most = cv2.dilate(wide, np.ones((2 * (wide.shape[0] // ROWS) + 1, 2 * (wide.shape[1] // COLUMNS) + 1)))
    grows = cv2.resize(most, (COLUMNS, ROWS), interpolation=cv2.INTER_NEAREST).reshape(-1) > 0.02
    triangles = grid_triangles(ROWS, COLUMNS)
    return np.ascontiguousarray(triangles[grows[triangles].any(axis=1)])
