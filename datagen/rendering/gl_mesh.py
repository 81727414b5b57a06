"""A model on the GPU: textures of its triangle pairs and of the current face, and the programs that read them."""

from importlib.resources import files
from typing import final

import moderngl
import numpy as np
from jaxtyping import Float32, Int32, Shaped, UInt32
from numpy import ndarray

from datagen.rendering.screen_projection import ScreenProjection
from datagen.rendering.triangle_pairs import local_order, pair_triangles
from pix2face.errors import UsageError
from pix2face.models.morphable_model import MorphableModel

# Lists lie in textures of this width (shaders/mesh.glsl).
TEXTURE_WIDTH = 1024
# Vertex numbers have 24 bits in the texture of pairs; regions and flags lie above (shaders/mesh.glsl).
VERTEX_BITS = 24
# Photographs come in several sizes: the number of sizes whose buffers are kept.
SIZES_KEPT = 8

# Where each texture is bound, in all programs.
TEXTURE_UNITS = {"screen": 0, "pairs": 1, "seen": 2, "mean": 3, "values": 4, "corners": 5}


@final
class GLMesh:
    """The mesh of one model.

    Raises:
        UsageError: The mesh is too large for the textures.
    """

    def __init__(self, model: MorphableModel, context: moderngl.Context) -> None:
        self.context = context
        largest = int(context.info["GL_MAX_TEXTURE_SIZE"]) * TEXTURE_WIDTH
        if max(len(model.mean), len(model.triangles)) >= min(1 << VERTEX_BITS, largest):
            raise UsageError(
                f"expected a model of fewer than {min(1 << VERTEX_BITS, largest):,} vertices and triangles, found "
                f"{len(model.mean):,} and {len(model.triangles):,} in {model.name}"
            )
        self._order = local_order(model.mean, model.triangles)
        self._is_reordered = bool((self._order != np.arange(len(self._order))).any())
        place = np.empty(len(self._order), dtype=np.int32)
        place[self._order] = np.arange(len(self._order), dtype=np.int32)
        self._pairs = pair_triangles(place[model.triangles])
        self.triangles: Int32[ndarray, "t 3"] = self._pairs.triangles
        self.n_pairs, self.n_triangles = len(self._pairs.corners), len(self.triangles)
        self.screen: Float32[ndarray, "padded 4"] = padded_list(len(model.mean))
        lists = {
            "screen": self.screen,
            "pairs": _flagged(self._pairs.corners, self._pairs.source, model),
            "mean": model.mean[self._order],
        }
        self._textures = {name: list_texture(context, values) for name, values in lists.items()}

    def program(self, fragment: str) -> moderngl.Program:
        """Compiles a fragment shader that knows what each pixel sees."""
        program = self.context.program(
            vertex_shader=shader_source(330, "whole_vertex"),
            fragment_shader=shader_source(330, "mesh", "sight", fragment),
        )
        self.set_units(program)
        program["n_triangles"] = self.n_triangles
        return program

    def set_units(self, program: moderngl.Program | moderngl.ComputeShader) -> None:
        """Tells a program where the textures are bound."""
        for name, unit in TEXTURE_UNITS.items():
            if name in program:
                program[name] = unit

    def load(self, projection: ScreenProjection) -> None:
        """Uploads a posed face, and binds what all passes read."""
        if self._is_reordered:
            np.take(projection.screen, self._order, axis=0, out=self.screen[: len(self._order)])
        else:
            self.screen[: len(self._order)] = projection.screen
        self._textures["screen"].write(self.screen)
        for name, texture in self._textures.items():
            texture.use(TEXTURE_UNITS[name])

    def corner_texture(self, corners: Int32[ndarray, "m 3"]) -> moderngl.Texture:
        """A texture of the numbers that values have at the corners of the model's triangles."""
        return list_texture(self.context, self._pairs.at_corners(corners))


def shader_source(version: int, *names: str) -> str:
    """Parts of ``datagen/rendering/shaders`` one after the other."""
    folder = files("datagen.rendering") / "shaders"
    parts = [(folder / f"{name}.glsl").read_text(encoding="utf-8") for name in names]
    return "\n".join([f"#version {version} core", *parts])


def list_texture(context: moderngl.Context, values: Shaped[ndarray, "n c"]) -> moderngl.Texture:
    """A texture of a list of up to four numbers each."""
    padded = padded_list(len(values), np.float32 if values.dtype.kind == "f" else np.uint32)
    padded[: len(values), : values.shape[1]] = values
    size, kind = (TEXTURE_WIDTH, len(padded) // TEXTURE_WIDTH), "f4" if padded.dtype == np.float32 else "u4"
    texture = context.texture(size, 4, padded, dtype=kind)
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


def padded_list(n: int, dtype: type = np.float32) -> Shaped[ndarray, "padded 4"]:
    """Zeros for a list of n times four numbers, as many as fill the rows of its texture."""
    return np.zeros((max(1, -(-n // TEXTURE_WIDTH)) * TEXTURE_WIDTH, 4), dtype)


def _flagged(corners: Int32[ndarray, "p 4"], source: ndarray, model: MorphableModel) -> UInt32[ndarray, "p 4"]:
    """Corners with the regions of both triangles above the first two, and above the third which of them are face."""
    first, second = source[0::2], source[1::2]
    flagged = corners.astype(np.uint32)
    is_face = model.is_face_triangle.astype(np.uint32)
    above = (model.triangle_regions[first], model.triangle_regions[second], is_face[first] | is_face[second] << 1)
    for column, bits in enumerate(above):
        flagged[:, column] |= bits.astype(np.uint32) << np.uint32(VERTEX_BITS)
    return flagged
