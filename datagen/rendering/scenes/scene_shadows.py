"""Depth maps as each light sees a scene, side by side in one texture (``shaders/shadow.glsl``)."""

from collections.abc import Callable, Sequence
from typing import final

import moderngl
import numpy as np
from jaxtyping import Float32, Float64, Int32
from numpy import ndarray

from datagen.appearance.scene import UniformValue
from datagen.rendering.processor.nearest import NOWHERE, draw_nearest
from datagen.rendering.scenes.scene_meshes import Window

MAX_SHADOWS = 3  # as in shadow.glsl
MAP_PX = 256
SKY, SKY_PX = 2, 128  # the third map, which is blurred; its part of a map as in shadow.glsl
# Radius of the sphere around the head that the maps show, with hair, hat and shoulders: share of the diagonal of the
# head's bounding box.
REACH = 0.6
TOWARDS_LIGHT = 3.0  # how far before the sphere something still casts a shadow, in radii

# Maps are drawn in clip space, and looked up by x, y and depth from 0 to 1.
SHADOW_FROM_CLIP = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])

Mesh = tuple[Float32[ndarray, "_ 3"], Int32[ndarray, "_ 3"]]  # vertices and triangles


@final
class ShadowMaps:
    """The depth maps of all lights, bound to one texture unit."""

    def __init__(self, context: moderngl.Context, unit: int) -> None:
        self._context, self._unit = context, unit
        self._maps = context.depth_texture((MAP_PX * MAX_SHADOWS, MAP_PX))
        self._maps.compare_func = "<="
        self._maps.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._maps.repeat_x = self._maps.repeat_y = False
        self._framebuffer = context.framebuffer([], self._maps)

    def draw(
        self,
        vertices: Float32[ndarray, "v 3"],
        lights: Float32[ndarray, "n 3"],
        solid: Callable[[int], Sequence[Mesh]],
        soft: Callable[[Window, Float64[ndarray, "3"]], None],
    ) -> dict[str, UniformValue]:
        """Draws a map for each light, with the head in the middle, and returns what ``shadow.glsl`` needs to know.

        Lights are directions towards them; zeros where there is none. ``solid`` says which opaque meshes a light sees,
        the first of them the head; ``soft`` draws the transparent ones, given what a light sees and its direction.
        """
        lights = lights[:MAX_SHADOWS]
        axes = np.ascontiguousarray(vertices.T)  # along rows it is twenty times as fast
        low, high = axes.min(axis=1).astype(np.float64), axes.max(axis=1).astype(np.float64)
        centre, radius = 0.5 * (low + high), REACH * float(np.linalg.norm(high - low))
        self._framebuffer.use()
        views = np.tile(np.eye(4), (MAX_SHADOWS, 1, 1))
        for place, direction in enumerate(np.asarray(lights, dtype=np.float64)):
            if not direction.any():
                continue  # no such lamp: nothing asks for its shadow
            clip_from_model = light_view(direction / np.linalg.norm(direction), centre, radius)
            side = SKY_PX if place == SKY else MAP_PX
            self._framebuffer.viewport = (place * MAP_PX, 0, side, side)
            views[place] = SHADOW_FROM_CLIP @ clip_from_model
            depth = _solid_depth(views[place], solid(place), side)
            self._maps.write(depth, viewport=self._framebuffer.viewport)
            soft(Window(clip_from_model, depth), direction)
        self._maps.use(self._unit)
        towards = np.zeros((MAX_SHADOWS, 3))
        towards[: len(lights)] = lights
        return {
            "shadow_maps": self._unit,
            "shadow_from_model": views,
            "shadow_lights": towards,
            "shadow_count": len(lights),
            "shadow_texel_mm": 2 * radius / MAP_PX,
            "shadow_texel": 1 / MAP_PX,
            "shadow_depth_mm": radius * (1 + TOWARDS_LIGHT),
        }


def _solid_depth(
    shadow_from_model: Float64[ndarray, "4 4"], meshes: Sequence[Mesh], side: int
) -> Float32[ndarray, "s s"]:
    """How deep what is opaque lies below each texel of a map, 0 to 1."""
    depth, labels = np.ones((side, side), dtype=np.float32), np.empty((side, side), dtype=np.float32)
    rows = (np.array([[side], [side], [1]]) * shadow_from_model[:3]).astype(np.float32)
    for place, (vertices, triangles) in enumerate(meshes):
        # What of the head turns away from a light would only shade what turns away as well.
        front = 1.0 if place == 0 else 0.0
        draw_nearest(vertices @ rows[:, :3].T + rows[:, 3], triangles, front, NOWHERE, (0.0, 0.0), depth, labels)
    return np.maximum(depth, 0, out=depth)


def light_view(
    direction: Float64[ndarray, "3"], centre: Float64[ndarray, "3"], radius_mm: float
) -> Float64[ndarray, "4 4"]:
    """Clip from model of an orthographic view along a light, of a sphere and of what is between it and the light."""
    across = np.cross(np.eye(3)[np.abs(direction).argmin()], direction)
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(direction, across)]) / radius_mm
    away = -2 * direction / (radius_mm * (1 + TOWARDS_LIGHT))
    clip = np.eye(4)
    clip[:2, :3], clip[:2, 3] = axes, -axes @ centre
    clip[2, :3] = away
    clip[2, 3] = 1 - away @ (centre - radius_mm * direction)  # the far end of the sphere is at 1
    return clip
