"""Hair of a synthetic photograph (hairdo, brows and lashes) as meshes, textures and uniforms.

docs/explanation/hair.md describes what varies, and how often.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from datagen.appearance.asset_files import read_picture
from datagen.appearance.hair.bound_meshes import bound_mesh, check_model
from datagen.appearance.hair.brows_and_lashes import (
    LASH_STYLES,
    Brows,
    Lashes,
    brow_mesh,
    brow_pictures,
    draw_brows,
    draw_lashes,
    lash_mesh,
)
from datagen.appearance.hair.hair_colour import HairColour, draw_hair_colour
from datagen.appearance.hair.hair_config import HairConfig
from datagen.appearance.hair.shape import CrownPlane, Parting, find_parting, shaped, uncovered
from datagen.appearance.hair.styles import STYLES, Hairdo, draw_hairdo
from datagen.appearance.person import Person
from datagen.appearance.scene import Colour, Material, PosedHead, SceneMesh, Texture, UniformValue
from datagen.random_streams import rounded

LAYERS = tuple(STYLES)
ROUND_SHARE = 0.5  # weight of the outline in the normals of strips, so that crossing strips do not flicker


@final
@dataclass(frozen=True, kw_only=True)
class Hair:
    """All hair of a head except the beard."""

    hairdo: Hairdo
    colour: HairColour
    brows: Brows
    lashes: Lashes
    seed: float  # of the strands' pattern, 0..100

    @property
    def scalp_colour(self) -> Colour:
        """Linear colour of short hair that is painted on the skin."""
        red, green, blue = (
            own + self.colour.grey_share * (grey - own)
            for own, grey in zip(self.colour.base, self.colour.grey, strict=True)
        )
        return red, green, blue


def draw_hair(rng: np.random.Generator, config: HairConfig, person: Person) -> Hair:
    """Draws the hair of a person."""
    colour = draw_hair_colour(rng, config, person)
    brows = draw_brows(rng, config, person, colour)
    return Hair(
        hairdo=draw_hairdo(rng, config, person),
        colour=colour,
        brows=brows,
        lashes=draw_lashes(rng, config, person, brows.colour),
        seed=rounded(rng.uniform(0, 100), 2),
    )


def hair_meshes(hair: Hair, head: PosedHead, crown: CrownPlane | None = None) -> list[SceneMesh]:
    """Makes the meshes of hair, which follows the neutral head, and of brows and lashes, which follow the expression.

    Hair above `crown`, the rim of a hat, is left out. Below it, hair lies close to the head.

    Raises:
        InputFileError: The head is not of the built-in model.
    """
    check_model(head.model)
    worn = (hair.hairdo.cap, hair.hairdo.style)
    meshes = [_style_mesh(style, hair, head, crown) for style in worn if style in STYLES]
    if hair.brows.alpha > 0:
        meshes.append(brow_mesh(hair.brows, head))
    if hair.lashes.alpha > 0:
        meshes.append(lash_mesh(hair.lashes, head))
    return meshes


def hair_uniforms(hair: Hair) -> dict[str, UniformValue]:
    """Returns the uniforms of `hair.glsl`."""
    colour = hair.colour
    return {
        "hair_tips": colour.tips,
        "hair_highlight": colour.highlight,
        "hair_grey": colour.grey,
        "hair_mix": (colour.grey_share, colour.highlight_share, colour.root_darkness, 0.85),
        "hair_reach": (colour.tips_from_mm, colour.tips_to_mm, hair.seed, 0.0),
    }


@cache
def hair_textures() -> Mapping[str, Texture]:
    """Reads the textures of hair, brows and lashes, and of the felt of a hat, by the names of their samplers."""
    strands, lashes = (
        np.stack([_with_direction(read_picture(f"hair/{name}.webp")) for name in names])
        for names in (LAYERS, LASH_STYLES)
    )
    return {
        "hair_strands": Texture(pixels=strands),
        "hair_lashes": Texture(pixels=lashes),
        "hair_brows": Texture(pixels=brow_pictures()),
        "hair_fedora": Texture(pixels=_felt(read_picture("hair/fedora.webp"))[None]),
    }


def _style_mesh(style: str, hair: Hair, head: PosedHead, crown: CrownPlane | None) -> SceneMesh:
    hairdo = hair.hairdo
    mesh = bound_mesh(style, is_mirrored=hairdo.is_mirrored)
    worn = shaped(mesh, _parting(style, hairdo.is_mirrored), hairdo, crown)
    points = worn + mesh.displacements(head.neutral, head.model.mean)
    return SceneMesh(
        name=f"hair/{style}",
        label="hair",
        vertices=points[mesh.point_of_vertex],
        triangles=uncovered(mesh, worn, crown),
        uv=mesh.uv,
        normals=_soft_normals(style, hairdo.is_mirrored),
        material=Material(
            kind="hair",
            texture="hair_strands",
            layer=LAYERS.index(style),
            colour=hair.colour.base,
            roughness=hair.colour.roughness,
            reflectance=0.045,
            numbers=(0.0, hairdo.density, hairdo.cut_mm, hairdo.thinning),
            is_blended=True,
        ),
    )


@cache
def _parting(style: str, is_mirrored: bool) -> Parting:
    if is_mirrored:
        other = _parting(style, False)
        return Parting(-other.left, -other.right)
    return find_parting(bound_mesh(style), read_picture(f"hair/{style}.webp"))


@cache
def _soft_normals(style: str, is_mirrored: bool) -> Float32[ndarray, "v 3"]:
    """Returns normals of vertices: means of those of the strips and those of the whole outline."""
    mesh = bound_mesh(style, is_mirrored=is_mirrored)
    # Away from the centre of the skull, or from a lower point for low hair. Hanging hair faces sideways.
    away = mesh.mean - np.array([0, min(40, mesh.mean[:, 1].max() - 60), 0], dtype=np.float32)
    away[:, 1] *= np.where(mesh.mean[:, 1] < 40, np.float32(0.3), 1)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    normals = (1 - ROUND_SHARE) * mesh.normals + ROUND_SHARE * away
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    return np.ascontiguousarray(normals[mesh.point_of_vertex], dtype=np.float32)


def _with_direction(picture: UInt8[ndarray, "h w 4"]) -> UInt8[ndarray, "h w 4"]:
    """Returns grey, alpha, and cosine and sine of twice the angle of the strands, for `hair.glsl`."""
    grey, alpha = picture[..., 0].astype(np.float32), picture[..., 3]
    across, down = cv2.Sobel(grey, -1, 1, 0), cv2.Sobel(grey, -1, 0, 1)
    weight = alpha.astype(np.float32) / 255
    # Structure tensor: the eigenvector of its smaller eigenvalue is the direction of the strands.
    difference = cv2.GaussianBlur((across**2 - down**2) * weight, (0, 0), 6)
    product = cv2.GaussianBlur(2 * across * down * weight, (0, 0), 6)
    length = np.maximum(np.hypot(difference, product), 1e-6)
    twice = np.stack([-difference / length, -product / length], axis=2)
    direction = np.clip(twice * 127.5 + 128, 0, 255).astype(np.uint8)
    return np.dstack([picture[..., 0], alpha, direction])


def _felt(picture: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 4"]:
    """Converts a picture for `material.glsl`: lightness, share of the second colour, dullness, opacity."""
    light = picture.astype(np.float32).mean(axis=2)
    light *= 255 * 0.8 / light.mean()
    out = np.full((*light.shape, 4), 255, dtype=np.uint8)
    out[..., 0], out[..., 1] = np.clip(light, 0, 255), 0
    return out
