"""The framebuffers of each step of drawing a scene."""

from dataclasses import dataclass
from typing import final

import moderngl
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from datagen.rendering.scenes.scene_program import UNITS


@final
@dataclass(frozen=True, eq=False)
class SceneTarget:
    """Framebuffers for one size of picture.

    Attributes:
        colours: The opaque surfaces at the centre of each pixel.
        kinds: The same colours; the depth says how the head is painted.
        edges: Where two surfaces share a pixel; the depth is that of the farther one.
        blended: The transparent surfaces over the nearer and over the farther surface, and their label. Depth of edges.
        picture: The result and the labels.
        textures: The attachments that later steps read, by the name of the sampler.
    """

    colours: moderngl.Framebuffer
    kinds: moderngl.Framebuffer
    edges: moderngl.Framebuffer
    blended: moderngl.Framebuffer
    picture: moderngl.Framebuffer
    textures: dict[str, moderngl.Texture]

    def bind(self) -> None:
        """Puts each texture at its unit."""
        for name, texture in self.textures.items():
            texture.use(UNITS[name])

    def read(self) -> tuple[Float32[ndarray, "h w 4"], UInt8[ndarray, "h w"]]:
        """Reads radiance times coverage (three channels) and coverage (one), and the labels."""
        width, height = self.picture.size
        colours = np.frombuffer(self.picture.read(components=4, dtype="f4"), dtype=np.float32)
        labels = np.frombuffer(self.picture.read(components=1, attachment=1, alignment=1), dtype=np.uint8)
        return colours.reshape(height, width, 4), labels.reshape(height, width).copy()


def make_target(context: moderngl.Context, height: int, width: int) -> SceneTarget:
    """Framebuffers for pictures of a size."""
    size, fine = (width, height), (2 * width + 1, 2 * height + 1)
    formats = {
        "seen": (fine, 2, "f4"),
        "colours": (size, 4, "f2"),
        "edges": (size, 4, "f4"),
        "over_near": (size, 4, "f2"),
        "over_far": (size, 4, "f2"),
        "blended_label": (size, 1, "f1"),
    }
    textures = {}
    for name, (extent, channels, kind) in formats.items():
        textures[name] = context.texture(extent, channels, dtype=kind)
        textures[name].filter = (moderngl.NEAREST, moderngl.NEAREST)
    far_depth = context.depth_renderbuffer(size)
    blended = [textures[name] for name in ("over_near", "over_far", "blended_label")]
    picture = [context.renderbuffer(size, 4, dtype="f4"), context.renderbuffer(size, 1)]
    return SceneTarget(
        colours=context.framebuffer([textures["colours"]], context.depth_renderbuffer(size)),
        kinds=context.framebuffer([textures["colours"]], context.depth_renderbuffer(size)),
        edges=context.framebuffer([textures["edges"]], far_depth),
        blended=context.framebuffer(blended, far_depth),
        picture=context.framebuffer(picture, context.depth_renderbuffer(size)),
        textures=textures,
    )
