"""Draws maps and layers of one model on the processor."""

import math
import threading
import weakref
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import final

import numpy as np
from jaxtyping import Float32, UInt32
from numpy import ndarray

from datagen.rendering.processor.interpolation import Maps, Surface, WayBack, draw_maps, interpolate
from datagen.rendering.processor.projection import largest_difference
from datagen.rendering.processor.visibility import Mesh, Seen, see
from datagen.rendering.screen_projection import ScreenProjection, project_to_screen
from pix2face.geometry.camera import Camera, WeakPerspective, weak_perspective_camera
from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import SURFACE_DEPTH
from pix2face.models.surface_attributes import ATTRIBUTES, REGIONS

# Photographs come in several sizes: the number of sizes whose memory is kept.
SIZES_KEPT = 2
# Of each size in bytes: PNCC and offset of one face, or its two depths.
ARRAYS_KEPT = 2
# Compiled functions are loaded in less; compiling them takes longer.
LOADED_WITHIN_S = 1.5
# What is interpolated in float32 is wrong by at most this part of the largest number.
ROUNDING = 2.0**-20


@final
class ProcessorMaps:
    """Draws the maps and further layers of one model."""

    def __init__(self, model: MorphableModel) -> None:
        self._model = model
        self._triangles: UInt32[ndarray, "t 3"] = np.ascontiguousarray(model.triangles, dtype=np.uint32)
        self._surface = Surface(np.pad(model.mean, ((0, 0), (0, 1))), model.is_face_triangle)
        self._largest_mean_mm = float(np.abs(model.mean).max(initial=0))
        # Written to again and again: new memory costs as much as what is done with it.
        self._screen: Float32[ndarray, "v 4"] = np.empty((len(model.mean), 4), np.float32)
        self._seen = lru_cache(SIZES_KEPT)(lambda size: Seen(np.empty(size, np.float32), np.empty(size, np.int32)))
        self._memory = lru_cache(SIZES_KEPT)(lambda size: _Memory())
        # By the number of the triangle; -1, the background, takes the last.
        self._regions = np.append(model.triangle_regions + np.uint8(1), np.uint8(0))

    def render(
        self,
        vertices: Float32[ndarray, "v 3"],
        camera: Camera,
        size: tuple[int, int],
        layers: Sequence[str] = (),
        *,
        in_steps: bool = False,
    ) -> dict[str, ndarray]:
        """Renders one face as ``Renderer.render`` does."""
        projection = project_to_screen(camera, vertices, *size, self._screen)
        attributes = [name for name in layers if name in ATTRIBUTES]
        mesh = Mesh(projection.screen, self._triangles)
        seen = self._seen(size)
        see(mesh, ROUNDING * max(map(abs, projection.order_range_mm)), seen)
        way = _way_back(projection)
        in_steps = in_steps and self._fits_in_steps(vertices)  # if not, whoever stores them says what is wrong
        maps = self._empty_maps(size, np.int16 if in_steps else np.float32, with_weights=bool(attributes))
        draw_maps(seen.triangle, mesh, self._surface, way, FIXED_POINT_STEPS_PER_MM * in_steps, maps)
        rendered = {
            "pncc": maps.pncc,
            "offset": maps.offset,
            "mask": maps.mask,
            "depth": maps.depth,
            SURFACE_DEPTH: maps.surface_depth,
        }
        for name in attributes:
            rendered[name] = self._attribute(name, vertices, camera, seen.triangle, maps)
        return rendered | {REGIONS: self._regions[seen.triangle]} if REGIONS in layers else rendered

    def _fits_in_steps(self, vertices: Float32[ndarray, "v 3"]) -> bool:
        """Whether PNCC and offsets, which lie between those of the vertices, can be stored in steps."""
        largest_mm = max(self._largest_mean_mm, float(largest_difference(vertices, self._surface.mean)))
        # Rounding takes interpolated values a little beyond those of the vertices: a millimetre is far more.
        return (largest_mm + 1) * FIXED_POINT_STEPS_PER_MM < np.iinfo(np.int16).max

    def _empty_maps(self, size: tuple[int, int], dtype: type, *, with_weights: bool) -> Maps:
        empty = self._memory(size).empty
        return Maps(
            empty((*size, 3), dtype),
            empty((*size, 3), dtype),
            empty(size, bool),
            empty(size, np.float32),
            empty(size, np.float32),
            np.empty((*size, 3) if with_weights else (0, 0, 0), np.float32),
        )

    def _attribute(
        self, name: str, vertices: Float32[ndarray, "v 3"], camera: Camera, seen: ndarray, maps: Maps
    ) -> Float32[ndarray, "h w c"]:
        attribute = ATTRIBUTES[name]
        values = np.ascontiguousarray(attribute.values(self._model, vertices, camera))
        corners = np.ascontiguousarray(attribute.corners(self._model), dtype=np.uint32)
        out = np.empty((*seen.shape, attribute.n_channels), dtype=np.float32)
        interpolate(seen, maps, values, corners, attribute.is_direction, out)
        return out


def prepare(model: MorphableModel, layers: Sequence[str], on_wait: Callable[[], None]) -> None:
    """Compiles what drawing needs, unless it was compiled before: workers that start at once then only load it.

    ``on_wait`` is called, in another thread, if this takes longer than loading.
    """
    timer = threading.Timer(LOADED_WITHIN_S, on_wait)
    timer.daemon = True
    timer.start()
    try:
        camera = weak_perspective_camera(WeakPerspective(0.1, np.diag([1.0, -1.0, -1.0]), np.full(2, 8.0)))
        ProcessorMaps(model).render(model.mean.copy(), camera, (16, 16), layers, in_steps=True)
    finally:
        timer.cancel()


@final
class _Memory:
    """Memory of arrays, which is used again when nobody sees them any more.

    The system hands out new memory page by page and fills it with 0: at 450 px that takes a quarter of a call.
    """

    def __init__(self) -> None:
        self._free: dict[int, list[bytearray]] = {}  # by its size

    def empty(self, shape: tuple[int, ...], dtype: type) -> ndarray:
        """An array with any numbers in it."""
        n_bytes = math.prod(shape) * np.dtype(dtype).itemsize
        free = self._free.setdefault(n_bytes, [])
        try:
            memory = free.pop()
        except IndexError:
            memory = bytearray(n_bytes)
        flat: ndarray = np.frombuffer(memory, dtype)  # lives as long as any array that shows a part of it

        def give_back() -> None:
            if len(free) < ARRAYS_KEPT:
                free.append(memory)

        weakref.finalize(flat, give_back).atexit = False
        return flat.reshape(shape)


def _way_back(projection: ScreenProjection) -> WayBack:
    names = ("middle", "middle_point", "along_column", "along_row", "along_depth")
    numbers = (projection.inverse_distance, projection.outside_sign, projection.reference_mm)
    return WayBack(
        *(getattr(projection, name).astype(np.float32, order="C") for name in names), *map(np.float32, numbers)
    )
