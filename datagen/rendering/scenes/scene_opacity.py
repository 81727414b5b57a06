"""Where transparent meshes of a scene are opaque, as ``hair.glsl`` and ``material.glsl`` say, but without OpenGL."""

from collections.abc import Mapping
from typing import NamedTuple, final

import cv2
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.scene import SceneMesh, Texture
from datagen.rendering.processor.opaque_parts import draw_opaque_parts
from datagen.rendering.scenes.scene_program import MaterialKind

CROWN = np.array([0.0, 128.0, -25.0], dtype=np.float32)
# Textures of strands are read as coarse as shadow maps are.
COARSER = 4
ALPHA_CHANNEL: dict[MaterialKind, int] = {"hair": 1, "object": 3}
FAR_MM = np.float32(1e6)


class Opacity(NamedTuple):
    """What of a mesh is opaque: arguments of `draw_opaque_parts`."""

    surface: Float32[ndarray, "v 4"]
    texture: Float32[ndarray, "h w 2"]
    density: float
    alpha: float  # of the material

    def draw(self, points: Float32[ndarray, "v 3"], mesh: SceneMesh, least: float, nearest: ndarray) -> None:
        """Draws what has at least some opacity."""
        if self.alpha >= least:
            opacity = self.density, least / self.alpha
            draw_opaque_parts(points, mesh.triangles, self.surface, self.texture, opacity, nearest)


@final
class Opacities:
    """The opacity of meshes with some textures, by the names of their samplers."""

    def __init__(self, textures: Mapping[str, Texture]) -> None:
        self._sources = textures
        self._textures: dict[tuple[str, int, MaterialKind], Float32[ndarray, "h w 2"]] = {}

    def of(self, mesh: SceneMesh) -> Opacity:
        """The opacity of a mesh, with the mean of the noise of strands: a shadow's edge is wider than a strand."""
        material = mesh.material
        surface = np.empty((len(mesh.vertices), 4), dtype=np.float32)
        surface[:, :2], surface[:, 2], surface[:, 3] = mesh.uv, FAR_MM, -FAR_MM
        if material.kind == "glass":
            gradient = np.linspace(1 + material.numbers[1], 1 - material.numbers[1], 64, dtype=np.float32)
            return Opacity(surface, np.stack([gradient, gradient], axis=1)[:, None], 1.0, material.alpha)
        texture = self._texture(material.texture, material.layer, material.kind)
        if material.kind == "object":
            return Opacity(surface, texture, 1.0, material.alpha)
        _, density, cut_mm, thinning = material.numbers
        surface[:, 2] = mesh.vertices[:, 1] - np.float32(cut_mm)
        if thinning > 0:
            surface[:, 3] = 95 * thinning - np.linalg.norm(mesh.vertices - CROWN, axis=1)
        return Opacity(surface, texture, density, material.alpha)

    def _texture(self, name: str, layer: int, kind: MaterialKind) -> Float32[ndarray, "h w 2"]:
        """Grey and alpha of a layer, 0 to 1."""
        key = name, layer, kind
        if key not in self._textures:
            source = self._sources.get(name)
            if source is None:
                self._textures[key] = np.array([[[0.5, 1.0]]], dtype=np.float32)
            else:
                pixels = source.pixels[layer][..., [0, ALPHA_CHANNEL[kind]]].astype(np.float32) / 255
                if kind == "hair":
                    height, width = (max(side // COARSER, 1) for side in pixels.shape[:2])
                    pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
                self._textures[key] = np.ascontiguousarray(pixels)
        return self._textures[key]
