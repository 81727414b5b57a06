"""The scene of a synthetic photograph: meshes with materials and textures, in NumPy.

The parts of an appearance (hair, glasses, clothes, ...) make meshes, and `datagen.rendering` draws them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, final

import numpy as np
from jaxtyping import Float32, Int32, Shaped
from numpy import ndarray
from scipy import sparse

from datagen.random_streams import Triple
from pix2face.models.morphable_model import MorphableModel

# What a pixel can show. The regions of the model divide the head further.
SCENE_LABELS = (
    "background",
    "head",
    "hair",
    "beard",
    "glasses",
    "headwear",
    "mask",
    "clothes",
    "jewellery",
    "occluder",
)
HEAD = SCENE_LABELS.index("head")
# What can be in front of a head, with the names of the layer `seen_regions`.
SCENE_REGIONS = SCENE_LABELS[HEAD + 1 :]
Colour = Triple  # linear light, 0..1, unless said otherwise
UniformValue = float | int | bool | tuple[float, ...] | ndarray


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Texture:
    """A stack of pictures for shaders."""

    # layers, rows from the top, columns, channels; UInt8 (0..1 in the shader) or Float16; colours are sRGB
    pixels: Shaped[ndarray, "n h w c"]
    repeat: bool = False  # whether it is repeated beyond its border, or its edge is
    mipmaps: bool = True  # whether it has mipmaps, for sampling at much smaller sizes


@final
@dataclass(frozen=True, kw_only=True)
class Material:
    """The material of a mesh, for `material.glsl`."""

    # function of the shader: `object` (cloth, plastic, metal, leather), `hair` (strands with alpha and highlights along
    # them) or `glass` (thin; reflects, and darkens what is behind)
    kind: Literal["object", "hair", "glass"]
    texture: str = ""  # name of a texture, or empty
    layer: int = 0  # layer of that texture
    colour: Colour = (1.0, 1.0, 1.0)  # factor on the colour of the texture
    alpha: float = 1.0  # factor on the alpha of the texture
    roughness: float = 0.6  # 0 is a mirror, 1 chalk
    reflectance: float = 0.04  # at normal incidence: 0.04 for skin and plastic, 0.5 and more for metal
    numbers: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # their meaning depends on the kind
    is_blended: bool = False  # partly transparent: drawn after everything opaque, far triangles first


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class SceneMesh:
    """The mesh of anything but the head in one picture."""

    name: str  # such as `hair/short01`, for messages
    label: str  # one of `SCENE_LABELS`
    vertices: Float32[ndarray, "v 3"]  # mm, model frame, fitted to this head
    triangles: Int32[ndarray, "t 3"]  # drawn from both sides
    uv: Float32[ndarray, "v 2"]  # origin at the top left of the texture; vertices on a seam occur twice
    normals: Float32[ndarray, "v 3"]  # unit, model frame, outward
    material: Material
    casts_shadow: bool = True


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class PosedHead:
    """The head of one picture, to which everything else is fitted."""

    model: MorphableModel
    vertices: Float32[ndarray, "v 3"]  # mm, model frame, with identity and expression
    normals: Float32[ndarray, "v 3"]  # unit, outward
    neutral: Float32[ndarray, "v 3"]  # the head without its expression, to which hats and glasses are fitted
    # strengths of active named expressions (`jawOpen`, ...), 0..1; empty if they are unknown
    named_expressions: Mapping[str, float] = field(default_factory=dict)


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """Everything that is drawn in one picture except the backdrop."""

    head: PosedHead
    meshes: Sequence[SceneMesh]  # everything except the head
    uniforms: Mapping[str, UniformValue]  # of `skin.glsl`, `light.glsl` and `material.glsl`, by name
    # unit vectors towards two lamps and the sky, which cast shadows (`shadow.glsl`), model frame; 0 without a lamp
    lights: Float32[ndarray, "n 3"]


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class ScenePicture:
    """A drawn scene."""

    radiance: Float32[ndarray, "h w 3"]  # linear light times coverage; 1 is white at exposure 1
    coverage: Float32[ndarray, "h w"]  # share of the pixel that the scene covers, 0..1
    # index into `SCENE_LABELS` of the nearest thing at the pixel's centre that is mostly opaque
    labels: Shaped[ndarray, "h w"]


@final
class Surface:
    """Regions and normals of a model's mesh, for painting and lighting."""

    def __init__(self, model: MorphableModel) -> None:
        n_vertices, n_triangles = len(model.mean), len(model.triangles)
        corner, triangle = model.triangles.reshape(-1), np.repeat(np.arange(n_triangles), 3)
        ones = np.ones(len(corner), dtype=np.float32)
        self._corners = tuple(model.triangles[:, k].astype(np.intp) for k in range(3))
        self._incidence = sparse.csr_array((ones, (corner, triangle)), shape=(n_vertices, n_triangles))
        in_region = np.eye(len(model.region_names), dtype=np.float32)[model.triangle_regions]
        weights = self._incidence @ in_region
        self.region_names = model.region_names
        # Shares of the regions among the triangles around each vertex; rows sum to 1. Colours mixed by them change
        # smoothly between regions, over one triangle.
        self.region_weights: Float32[ndarray, "v r"] = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1)
        self.mean = model.mean

    def normals(self, vertices: Float32[ndarray, "v 3"]) -> Float32[ndarray, "v 3"]:
        """Returns unit normals, outward: area-weighted means over the triangles around each vertex; 0 without any."""
        # By coordinates and in place, which takes a third of the time of `numpy.cross`. Every picture needs it.
        x = np.ascontiguousarray(vertices.T)
        a, p, q = (x.take(corner, axis=1) for corner in self._corners)
        p -= a
        q -= a
        across = np.empty((p.shape[1], 3), dtype=np.float32)
        across[:, 0] = p[1] * q[2] - p[2] * q[1]
        across[:, 1] = p[2] * q[0] - p[0] * q[2]
        across[:, 2] = p[0] * q[1] - p[1] * q[0]
        normals = self._incidence @ across
        length = np.sqrt(np.einsum("vc,vc->v", normals, normals))
        normals /= np.where(length > 0, length, np.float32(1))[:, None]
        return np.asarray(normals, dtype=np.float32)
