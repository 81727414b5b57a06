"""Finds the nearest triangle of each pixel by OpenGL's own rasteriser: for OpenGL below 4.3, and as a second opinion.

Its vertices snap to a grid of 1/256 pixel or so, and a pixel centre within that of an edge may be given to the wrong
side. In small images that is a large part of them, and there it costs little to draw several times as fine.
"""

from functools import lru_cache
from typing import final

import moderngl
import numpy as np

from datagen.rendering.clip_space import DEPTH_MARGIN
from datagen.rendering.gl_mesh import SIZES_KEPT, TEXTURE_UNITS, GLMesh
from datagen.rendering.screen_projection import ScreenProjection

# Images are drawn as fine as stays below this size: at 256 px and above, snapping is wrong for one pixel in 10,000.
FINE_SIZE_PX = 768


@final
class FragmentRasteriser:
    """Finds the nearest triangle of each pixel, for one mesh."""

    def __init__(self, mesh: GLMesh) -> None:
        self._mesh, self._context = mesh, mesh.context
        self._program = mesh.program("raster_fragment", "raster_vertex", with_sight=False)
        self._vertices = self._context.buffer(reserve=mesh.screen.nbytes, dynamic=True)
        self._vertex_array = self._context.vertex_array(
            self._program, [(self._vertices, "3f4 1x4", "position")], self._context.buffer(mesh.triangles)
        )
        self._targets = lru_cache(SIZES_KEPT)(self._make)

    def see(self, projection: ScreenProjection, height: int, width: int) -> int:
        """Binds a texture of the nearest triangle of each pixel in the projection's box.

        The mesh must have been loaded with the projection. Outside the box the texture is undefined.

        Returns:
            How many texels a pixel has in each direction: odd.
        """
        finer = max(1, ((FINE_SIZE_PX - 1) // max(height, width) - 1) // 2 * 2 + 1)
        target, seen = self._targets(finer * height, finer * width)
        low, high = projection.order_range_mm
        scale = 2 * (1 - DEPTH_MARGIN) / max(high - low, 1e-6)
        self._vertices.write(self._mesh.screen)
        self._program["clip_from_screen"] = (2 / width, 2 / height, scale, -scale * (low + high) / 2)
        # A clear would write a float into whole numbers.
        seen.write(np.full(seen.size, 0xFFFFFFFF, dtype=np.uint32))
        for colours in (False, True):  # masks count from the next use on
            target.color_mask = colours, colours, colours, colours
            target.use()
            if not colours:
                target.clear()
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._vertex_array.render(moderngl.TRIANGLES)
        seen.use(TEXTURE_UNITS["seen"])
        return finer

    def _make(self, height: int, width: int) -> tuple[moderngl.Framebuffer, moderngl.Texture]:
        seen = self._context.texture((width, height), 1, dtype="u4")
        seen.filter = (moderngl.NEAREST, moderngl.NEAREST)
        # 24 bits of depth, all that moderngl offers, are steps of some 0.00002 mm over a head.
        depth = self._context.depth_renderbuffer((width, height))
        return self._context.framebuffer([seen], depth), seen
