"""What a scene is drawn into with OpenGL."""

from dataclasses import dataclass
from typing import final

import moderngl
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from datagen.rendering.processor.scene_edges import SceneEdges
from datagen.rendering.scenes.scene_program import UNITS


@final
@dataclass(frozen=True, eq=False)
class SceneTarget:
    """Framebuffers for one size of picture.

    Attributes:
        colours: The opaque surfaces at the centre of each pixel.
        kinds: The same colours; the depth says how the head is painted.
        blended: The transparent surfaces over the nearer and over the farther surface, and their label.
        depths: The depth of each of them, by its name.
        textures: What shaders read, by the name of the sampler.
    """

    colours: moderngl.Framebuffer
    kinds: moderngl.Framebuffer
    blended: moderngl.Framebuffer
    depths: dict[str, moderngl.Texture]
    textures: dict[str, moderngl.Texture]

    def clear(self, edges: SceneEdges) -> None:
        """Clears all colours, and uploads what shaders and tests of depth need to know of the samples."""
        for framebuffer in (self.colours, self.blended):
            framebuffer.clear()
        self.depths["colours"].write(edges.opaque)
        self.depths["blended"].write(edges.farther)
        for name, values in (("seen", edges.triangle), ("edges", edges.depths)):
            self.textures[name].write(values)
            self.textures[name].use(UNITS[name])

    def read_colours(self) -> Float32[ndarray, "h w 4"]:
        """Reads the opaque surfaces."""
        return self._pixels(self.colours, 0)

    def read_blended(
        self,
    ) -> tuple[tuple[Float32[ndarray, "h w 4"], Float32[ndarray, "h w 4"]], UInt8[ndarray, "h w"]]:
        """Reads the transparent surfaces over the nearer and over the farther surface, and their labels."""
        labels = np.frombuffer(self.blended.read(components=1, attachment=2, alignment=1), dtype=np.uint8)
        width, height = self.blended.size
        return (self._pixels(self.blended, 0), self._pixels(self.blended, 1)), labels.reshape(height, width)

    def _pixels(self, framebuffer: moderngl.Framebuffer, attachment: int) -> Float32[ndarray, "h w 4"]:
        width, height = framebuffer.size
        pixels = np.frombuffer(framebuffer.read(components=4, attachment=attachment, dtype="f4"), dtype=np.float32)
        return pixels.reshape(height, width, 4)


def make_target(context: moderngl.Context, height: int, width: int) -> SceneTarget:
    """Framebuffers for pictures of a size."""
    size = (width, height)
    textures = {"seen": context.texture(size, 1, dtype="f4"), "edges": context.texture(size, 2, dtype="f4")}
    for texture in textures.values():
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    depths = {name: context.depth_texture(size) for name in ("colours", "kinds", "blended")}
    colours = context.renderbuffer(size, 4, dtype="f4")
    blended = [*(context.renderbuffer(size, 4, dtype="f4") for _ in range(2)), context.renderbuffer(size, 1)]
    return SceneTarget(
        colours=context.framebuffer([colours], depths["colours"]),
        kinds=context.framebuffer([colours], depths["kinds"]),
        blended=context.framebuffer(blended, depths["blended"]),
        depths=depths,
        textures=textures,
    )
