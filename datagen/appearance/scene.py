"""What stands before the camera of a synthetic photograph: meshes, what they are made of, and textures.

Everything here is plain NumPy. Parts of an appearance (hair, glasses, clothes, ...) give meshes; the drawer in
``datagen.rendering`` turns them into pixels.
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

# What can be seen in a pixel of a picture; its place is its number in the layer ``seen_regions``. The head stands for
# all regions of the model; where it is seen, the model's own regions say more.
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
# What stands before a head, by the names that the layer ``seen_regions`` has for it.
SCENE_REGIONS = SCENE_LABELS[HEAD + 1 :]
Colour = Triple  # linear light, 0..1, unless said otherwise
UniformValue = float | int | bool | tuple[float, ...] | ndarray


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Texture:
    """A stack of pictures for shaders.

    Attributes:
        pixels: Layers, rows from the top, columns, channels; UInt8 (0..1 in the shader) or Float16 (as it is). Colours
            are stored as sRGB and made linear by the shader, where they are colours.
        repeat: Beyond its border it starts anew, instead of going on as the border is.
        mipmaps: Is sampled much smaller than it is.
    """

    pixels: Shaped[ndarray, "n h w c"]
    repeat: bool = False
    mipmaps: bool = True


@final
@dataclass(frozen=True, kw_only=True)
class Material:
    """What a mesh is made of, for ``material.glsl``.

    Attributes:
        kind: Which function of the shader paints it: ``object`` (cloth, plastic, metal, leather), ``hair`` (strands,
            alpha, highlights along them) or ``glass`` (thin, mirrors, darkens what is behind).
        texture: Name of a texture among those of the part, and the layer of it; empty where there is none.
        layer: Which of its pictures.
        colour: Linear, 0..1; multiplies the texture.
        alpha: Multiplies the texture's.
        roughness: 0 a mirror, 1 chalk.
        reflectance: Of light that falls at a right angle: 0.04 skin and plastic, 0.5 and more metal.
        numbers: Up to four more, whose meaning is the kind's.
        is_blended: Parts of it are transparent: it is drawn after everything opaque, far triangles first.
    """

    kind: Literal["object", "hair", "glass"]
    texture: str = ""
    layer: int = 0
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    alpha: float = 1.0
    roughness: float = 0.6
    reflectance: float = 0.04
    numbers: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    is_blended: bool = False


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class SceneMesh:
    """Something that is not the head, as it is in one picture.

    Attributes:
        name: For messages, such as ``hair/short01``.
        label: One of ``SCENE_LABELS``.
        vertices: mm, model frame, following this head.
        triangles: Drawn from both sides.
        uv: Texture coordinates of each vertex, the origin at the top left of the texture; vertices on a seam stand
            here twice.
        normals: Unit, model frame, outward.
        material: What it is made of.
        casts_shadow: Whether light stops at it.
    """

    name: str
    label: str
    vertices: Float32[ndarray, "v 3"]
    triangles: Int32[ndarray, "t 3"]
    uv: Float32[ndarray, "v 2"]
    normals: Float32[ndarray, "v 3"]
    material: Material
    casts_shadow: bool = True


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class PosedHead:
    """The head of one picture, which everything else is fitted to.

    Attributes:
        model: Its model.
        vertices: mm, model frame, identity and expression in it.
        normals: Unit, outward.
        neutral: The same head without its expression, mm: what hats and glasses are fitted to.
        named_expressions: How strongly each named expression of the model is active, 0..1, as far as it is known
            (``jawOpen``, ``eyeBlinkLeft``, ...); missing ones are 0.
    """

    model: MorphableModel
    vertices: Float32[ndarray, "v 3"]
    normals: Float32[ndarray, "v 3"]
    neutral: Float32[ndarray, "v 3"]
    named_expressions: Mapping[str, float] = field(default_factory=dict)


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """All that is drawn of one picture, but for what is behind it.

    Attributes:
        head: The head.
        meshes: Everything else.
        uniforms: Of ``skin.glsl``, ``light.glsl`` and ``material.glsl``, by name.
        lights: Towards each light that casts shadows, unit vectors in the model frame; at most 2, the first the
            strongest. ``shadow(i, point)`` in ``shadow.glsl`` answers for the i-th.
    """

    head: PosedHead
    meshes: Sequence[SceneMesh]
    uniforms: Mapping[str, UniformValue]
    lights: Float32[ndarray, "n 3"]


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class ScenePicture:
    """A drawn scene.

    Attributes:
        radiance: Linear light, 1 is white at exposure 1; multiplied by coverage.
        coverage: 0..1, how much of the pixel the scene takes.
        labels: Number in ``SCENE_LABELS`` of what is nearest at the pixel's centre and more opaque than not.
    """

    radiance: Float32[ndarray, "h w 3"]
    coverage: Float32[ndarray, "h w"]
    labels: Shaped[ndarray, "h w"]


@final
class Surface:
    """Neighbourhoods of a model's vertices.

    Attributes:
        mean: The mean face, mm: where on a face a vertex is.
        region_names: The model's.
        region_weights: For each vertex, how much of its surroundings belongs to each region; rows sum to 1. Colours
            mixed by them fade over one triangle where regions meet.
    """

    def __init__(self, model: MorphableModel) -> None:
        n_vertices, n_triangles = len(model.mean), len(model.triangles)
        corner, triangle = model.triangles.reshape(-1), np.repeat(np.arange(n_triangles), 3)
        ones = np.ones(len(corner), dtype=np.float32)
        self._corners = tuple(model.triangles[:, k].astype(np.intp) for k in range(3))
        self._incidence = sparse.csr_array((ones, (corner, triangle)), shape=(n_vertices, n_triangles))
        in_region = np.eye(len(model.region_names), dtype=np.float32)[model.triangle_regions]
        weights = self._incidence @ in_region
        self.region_names = model.region_names
        self.region_weights: Float32[ndarray, "v r"] = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1)
        self.mean = model.mean

    def normals(self, vertices: Float32[ndarray, "v 3"]) -> Float32[ndarray, "v 3"]:
        """Unit normals, outward: the mean of the triangles around, by area. 0 at a vertex without triangles."""
        # By coordinates and in place, as this is done for every picture: a third of the time of ``numpy.cross``.
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
