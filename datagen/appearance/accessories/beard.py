"""Beards and moustaches: shells of strands over the lower face, without the lips, that follow the expression."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8
from numpy import ndarray

from datagen.appearance.accessories.head_fit import Anchors, grid_outward
from datagen.appearance.person import Person
from datagen.appearance.scene import Colour, Material, PosedHead, SceneMesh, Texture
from datagen.appearance.solids import grid_triangles, grid_uv, scene_mesh, solid, unit
from datagen.random_streams import rounded, triple, weighted_choice
from pix2face.models.morphable_model import MorphableModel, builtin_model

BEARD_STRANDS = "accessory_beards"
LEVELS = 3  # texture layers of a style: dense at the skin, sparse at the tips
WIDTH, HEIGHT = 256, 192
ROWS, COLUMNS = 26, 49

# Weights of the styles.
_WEIGHTS = {"full": 0.30, "boxed": 0.20, "goatee": 0.14, "chin": 0.07, "moustache": 0.14, "handlebar": 0.05}
_WEIGHTS |= {"strap": 0.04, "mutton": 0.03, "whiskers": 0.03}
STYLES = tuple(_WEIGHTS)
_CENTRE = (0.0, -28.0, 38.0)
_AROUND_DEG, _TOP_DEG, _BOTTOM_DEG = 122.0, 48.0, -84.0


def beard_anchors(model: MorphableModel) -> Anchors:
    """Returns a grid over the lower face of a model, rows from the top."""
    return grid_outward(model, _CENTRE, (_TOP_DEG, _BOTTOM_DEG), _AROUND_DEG, (ROWS, COLUMNS))


@lru_cache(maxsize=1)
def beard_textures() -> Mapping[str, Texture]:
    """Returns the texture of all styles, `LEVELS` layers each: grey, alpha and direction of the strands."""
    layers = [_layer(density, level) for density in style_densities().values() for level in range(LEVELS)]
    return {BEARD_STRANDS: Texture(pixels=np.stack(layers))}


def beard_layer(style: str, level: int) -> int:
    """Returns the texture layer of a level of a style."""
    return STYLES.index(style) * LEVELS + level


@lru_cache(maxsize=1)
def style_densities() -> Mapping[str, Float32[ndarray, "h w"]]:
    """Returns the density of each style over the grid, 0..1."""
    model = builtin_model()
    grid = beard_anchors(model).at(model.mean).reshape(ROWS, COLUMNS, 3)
    columns, rows = np.meshgrid(
        np.linspace(0, COLUMNS - 1, WIDTH, dtype=np.float32), np.linspace(0, ROWS - 1, HEIGHT, dtype=np.float32)
    )
    place = cv2.remap(grid, columns, rows, cv2.INTER_LINEAR)
    x, y, z = np.abs(place[..., 0]), place[..., 1], place[..., 2]
    mouth = np.sqrt((x / 27.5) ** 2 + ((y + 43.5) / 10.8) ** 2)
    beside_lips = np.where(z > 70, _smoothstep(1.0, 1.16, mouth), 1.0)
    above_throat = _smoothstep(-100, -90, y) * _smoothstep(4, 14, z + 0.45 * np.clip(y + 70, -40, 90))
    allowed = beside_lips * above_throat * _smoothstep(6, 12, np.hypot(x, 0.9 * (y + 12)) - 6 * (z < 90))
    return {
        name: np.asarray(np.clip(density, 0, 1) * allowed, dtype=np.float32)
        for name, density in _styles(x, y, z).items()
    }


def _smoothstep(low: ndarray | float, high: ndarray | float, value: ndarray) -> ndarray:
    """Rises smoothly from 0 at `low` to 1 at `high`, or falls if `high` is below `low`."""
    t = np.clip((value - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def _styles(x: ndarray, y: ndarray, z: ndarray) -> dict[str, ndarray]:
    """Returns the density of each style at places of the mean head (mm, absolute x), including lips and throat."""

    def below_cheek(drop_mm: float) -> ndarray:
        line = np.interp(x, [0, 24, 42, 56, 64, 70, 74], [-30, -30, -34, -24, -10, 12, 26]) - drop_mm * (x < 64)
        return _smoothstep(line + 3, line - 4, y)

    in_front = _smoothstep(0, 9, z)
    whiskers = _smoothstep(61, 66, x) * _smoothstep(25, 17, y) * _smoothstep(1, 8, z) * _smoothstep(38, 30, z)
    top = -22.5 - 0.006 * x**2
    moustache = _smoothstep(top + 1, top - 3, y) * _smoothstep(31, 25, x) * _smoothstep(-47, -43, y) * (z > 75)
    ends = _smoothstep(21, 26, x) * _smoothstep(37, 32, x) * _smoothstep(-72, -66, y) * _smoothstep(-34, -38, y)
    wide = 26 - 0.12 * np.maximum(y + 60, 0)
    chin = _smoothstep(wide + 4, wide - 2, x) * _smoothstep(-53, -58, y) * _smoothstep(44, 54, z)
    beside = _smoothstep(22, 25, x) * _smoothstep(36, 31, x) * _smoothstep(-30, -36, y) * (z > 55)
    goatee = np.maximum.reduce([moustache, chin, beside])
    along_jaw = below_cheek(30) * _smoothstep(-58, -66, y - 0.5 * np.maximum(x - 40, 0))
    return {
        "full": np.maximum.reduce([below_cheek(0) * in_front, moustache, whiskers]),
        "boxed": np.maximum.reduce([below_cheek(14) * in_front, goatee, whiskers]),
        "goatee": goatee,
        "chin": chin,
        "moustache": moustache,
        "handlebar": np.maximum(moustache, ends * (z > 60)),
        "strap": np.maximum(along_jaw, whiskers),
        "mutton": np.maximum(below_cheek(4) * _smoothstep(30, 38, x) * in_front, whiskers),
        "whiskers": whiskers,
    }


def _layer(density: Float[ndarray, "h w"], level: int) -> UInt8[ndarray, "h w 4"]:
    """Draws strands along v, from noise that is stretched in this direction."""
    rng = np.random.default_rng(level)
    noise = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)).astype(np.float32), (0, 0), 0.6, sigmaY=3.0)
    curls = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)).astype(np.float32), (0, 0), 4.0)
    strands = noise / noise.std() + 0.5 * curls / curls.std()
    bar = (-2.0, -0.6, 0.5)[level]
    alpha = np.clip((strands - bar + 2.2 * (density - 0.8)) * 0.8, 0, 1) * _smoothstep(0.02, 0.5, density)
    alpha *= (0.92, 0.85, 0.75)[level]
    grey = np.clip(0.5 + 0.13 * strands + (-0.12, 0.0, 0.1)[level], 0, 1)
    downward = np.zeros_like(grey), np.full_like(grey, 0.5)
    return (np.stack([grey, alpha, *downward], axis=-1) * 255 + 0.5).astype(np.uint8)


@final
@dataclass(frozen=True, kw_only=True)
class Beard:
    """A beard."""

    style: str  # one of `STYLES`
    thickness_mm: float  # distance of the tips from the skin
    hang_mm: float  # length below the chin
    density: float  # density of the strands; 1 is dense
    greyness: float  # 0 has the colour of the hair, 1 is white
    darkening: float  # factor on the colour of the hair


def draw_beard(rng: np.random.Generator, person: Person) -> Beard:
    """Draws a beard, most often a short one. Beards turn grey at a younger age than hair."""
    style = weighted_choice(rng, _WEIGHTS)
    is_long = style in ("full", "chin", "goatee") and rng.uniform() < 0.22
    thickness = rng.uniform(7, 15) if is_long else rng.uniform(1.2, 6.0)
    old = 1 / (1 + np.exp(-(person.age_years - 55) / 7))
    return Beard(
        style=style,
        thickness_mm=rounded(thickness, 2),
        hang_mm=rounded(rng.gamma(2, 14) + 8, 2) if is_long else rounded(rng.uniform(0, 3), 2),
        density=rounded(np.clip(rng.normal(1.0, 0.18), 0.5, 1.3)),
        greyness=rounded(np.clip(rng.normal(1.2 * old - 0.15, 0.2), 0, 1)),
        darkening=rounded(rng.uniform(0.65, 1.1)),
    )


def beard_meshes(beard: Beard, head: PosedHead, hair_rgb: Colour) -> list[SceneMesh]:
    """Makes the shells of a beard on a head with its expression, from the skin outward; `hair_rgb` is linear."""
    anchors = beard_anchors(head.model)
    skin, normals = anchors.at(head.vertices), unit(anchors.at(head.normals))
    reach, hang = _growth(beard.style)
    triangles = _grown_triangles(beard.style)
    count = 3 if beard.thickness_mm < 2.5 else 4 if beard.thickness_mm < 6 else 6
    colour = np.asarray(hair_rgb) * beard.darkening * (1 - beard.greyness) + beard.greyness * np.array([0.5, 0.5, 0.49])
    meshes = []
    for shell, share in enumerate(np.linspace(0, 1, count)):
        out = 0.4 + share * beard.thickness_mm * reach  # mm above the skin
        down = share**1.3 * beard.hang_mm * hang
        points = skin + out[:, None] * normals + down[:, None] * np.array([0.0, -1.0, 0.12], dtype=np.float32)
        level = min(int(share * LEVELS), LEVELS - 1)
        material = Material(
            kind="hair",
            texture=BEARD_STRANDS,
            layer=beard_layer(beard.style, level),
            colour=triple(np.clip(colour, 0, 1), 5),
            roughness=0.5,
            numbers=(1.0, beard.density, -1e3, 0.0),
            is_blended=True,
        )
        made = solid(points, triangles, grid_uv(ROWS, COLUMNS), normals)
        meshes.append(scene_mesh(f"beard/{beard.style}{shell}", "beard", made, material, casts_shadow=shell == 0))
    return meshes


@lru_cache(maxsize=16)
def _growth(style: str) -> tuple[Float32[ndarray, " v"], Float32[ndarray, " v"]]:
    """Returns the share of the thickness (less at the border) and of the hanging length at each point of the grid."""
    soft = cv2.GaussianBlur(style_densities()[style], (0, 0), 6.0)
    reach = np.clip(cv2.resize(soft, (COLUMNS, ROWS), interpolation=cv2.INTER_LINEAR).reshape(-1) * 1.3 - 0.1, 0, 1)
    uv = grid_uv(ROWS, COLUMNS)
    around = np.abs(uv[:, 0] - 0.5) * 2
    hang = np.clip((uv[:, 1] - 0.55) / 0.25, 0, 1) * np.clip(1 - around / 0.75, 0, 1) * reach
    return np.asarray(reach, dtype=np.float32), np.asarray(hang, dtype=np.float32)


@lru_cache(maxsize=16)
def _grown_triangles(style: str) -> Int32[ndarray, "t 3"]:
    """Returns the triangles with any density."""
    most = cv2.dilate(style_densities()[style], np.ones((2 * (HEIGHT // ROWS) + 3, 2 * (WIDTH // COLUMNS) + 3)))
    grows = cv2.resize(most, (COLUMNS, ROWS), interpolation=cv2.INTER_NEAREST).reshape(-1) > 0.02
    triangles = grid_triangles(ROWS, COLUMNS)
    return np.ascontiguousarray(triangles[grows[triangles].any(axis=1)])
