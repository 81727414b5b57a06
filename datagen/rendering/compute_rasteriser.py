"""Finds the nearest triangle of each pixel in OpenGL's compute shaders.

The fixed pipeline spends its time on the set-up of triangles, and those of a face are smaller than a pixel. Here a
triangle costs what it covers, edges are decided in full float32, and the smallest of (depth, triangle) is kept by an
atomic minimum, so that the result does not depend on the order of threads.
"""

from functools import lru_cache
from typing import final

import moderngl
import numpy as np
from jaxtyping import Float64, UInt32
from numpy import ndarray

from datagen.rendering.gl_mesh import SIZES_KEPT, TEXTURE_UNITS, GLMesh, shader_source
from datagen.rendering.screen_projection import ScreenProjection

# Of the shader: a thread takes this many pairs, or the start of threads costs more than their work.
LOCAL_SIZE, PAIRS_PER_THREAD = 512, 4
NONE = np.uint32(0xFFFFFFFF)


@final
class ComputeRasteriser:
    """Finds the nearest triangle of each pixel, for one mesh."""

    def __init__(self, mesh: GLMesh) -> None:
        self._mesh, self._context = mesh, mesh.context
        self._shader = mesh.context.compute_shader(shader_source(430, "mesh", "raster_compute"))
        mesh.set_units(self._shader)
        self._triangle_bits = int(mesh.n_triangles).bit_length()  # all ones is no triangle
        self._shader["n_pairs"] = mesh.n_pairs
        self._shader["triangle_bits"] = self._triangle_bits
        self._keys = lru_cache(SIZES_KEPT)(self._make)
        self._groups = -(-mesh.n_pairs // (LOCAL_SIZE * PAIRS_PER_THREAD))

    def see(self, projection: ScreenProjection, height: int, width: int) -> None:
        """Binds a texture of the nearest triangle of each pixel in the projection's box.

        The mesh must have been loaded with the projection. Outside the box the texture is undefined.
        """
        keys_lowest, keys_highest, seen = self._keys(height, width)
        top, bottom = projection.box_px[1], projection.box_px[3]
        seen.use(TEXTURE_UNITS["seen"])
        if top == bottom:
            return
        n_pixels, first_byte = (bottom - top) * width, top * width * 4
        clear = np.full(n_pixels, NONE)
        for binding, buffer in enumerate((keys_lowest, keys_highest)):
            buffer.write(clear, offset=first_byte)
            buffer.bind_to_storage_buffer(binding)
        low, high = projection.order_range_mm
        steps = float((int(NONE) >> self._triangle_bits) - 1)
        self._shader["size"] = (width, height)
        self._shader["coarse_depth"] = (low, steps / max(high - low, 1e-6))
        self._shader.run(self._groups)
        self._context.memory_barrier()
        lowest, highest = clear, np.empty_like(clear)  # the buffers have taken the copy
        keys_lowest.read_into(lowest, size=lowest.nbytes, offset=first_byte)
        keys_highest.read_into(highest, size=highest.nbytes, offset=first_byte)
        seen.write(self._nearest(lowest, highest, top, width), viewport=(0, top, width, bottom - top))

    def _nearest(self, lowest: UInt32[ndarray, " n"], highest: UInt32[ndarray, " n"], top: int, width: int) -> ndarray:
        """The nearest triangle of each pixel, from the keys of the shader."""
        every = np.uint32((1 << self._triangle_bits) - 1)
        # A tie of triangles farther away has left a key of its own depth.
        undecided = np.flatnonzero(((highest ^ lowest) <= every) & (lowest != NONE))
        lowest &= every
        if len(undecided):
            first = lowest[undecided].astype(np.int64)
            second = (every - (highest[undecided] & every)).astype(np.int64)
            centre = np.stack([undecided % width, undecided // width + top], axis=1) + 0.5
            corners = self._mesh.screen[:, :3]
            depths = [
                depth_at(corners[self._mesh.triangles[each]].astype(np.float64), centre) for each in (first, second)
            ]
            lowest[undecided] = np.where(depths[1] < depths[0], second, first)
        return lowest

    def _make(self, height: int, width: int) -> tuple[moderngl.Buffer, moderngl.Buffer, moderngl.Texture]:
        """The smallest and largest key of each pixel, and its nearest triangle."""
        lowest, highest = (self._context.buffer(reserve=4 * height * width) for _ in range(2))
        seen = self._context.texture((width, height), 1, dtype="u4")
        seen.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return lowest, highest, seen


def depth_at(corners: Float64[ndarray, "n 3 3"], centre: Float64[ndarray, "n 2"]) -> Float64[ndarray, " n"]:
    """Third coordinate of triangles (column, row, depth) at points of the image that they cover."""
    start, end = np.roll(corners[:, :, :2], -1, axis=1), np.roll(corners[:, :, :2], -2, axis=1)
    start, end = start - centre[:, None], end - centre[:, None]
    sides = start[..., 0] * end[..., 1] - start[..., 1] * end[..., 0]
    area = sides.sum(axis=1)
    depth = (sides * corners[:, :, 2]).sum(axis=1) / np.where(area == 0, 1, area)
    return np.asarray(np.where(area == 0, corners[:, :, 2].mean(axis=1), depth))
