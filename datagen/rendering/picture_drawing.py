"""Draws the plain picture of a face of a model that has no photographs: lit, painted, edges smooth."""

from functools import lru_cache
from typing import final

import cv2
import moderngl
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from datagen.appearance.plain_appearance import PlainAppearance, lights_in_model, vertex_paint
from datagen.appearance.scene import Surface
from datagen.rendering.clip_space import clip_transform
from datagen.rendering.gl_mesh import SIZES_KEPT, shader_source
from pix2face.geometry.camera import Camera
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import handedness, project_homogeneous

# Pictures (never maps) are drawn this much finer and averaged, so that edges are as smooth as a lens makes them.
PICTURE_OVERSAMPLING = 2


@final
class PictureDrawer:
    """Draws pictures of one model."""

    def __init__(self, model: MorphableModel, context: moderngl.Context) -> None:
        self._context = context
        self._surface = Surface(model)
        n_bytes = model.mean.nbytes
        self._vertices, self._normals = (context.buffer(reserve=n_bytes, dynamic=True) for _ in range(2))
        self._paint = context.buffer(reserve=n_bytes // 3 * 4, dynamic=True)
        self._program = context.program(
            vertex_shader=shader_source(330, "picture_vertex"), fragment_shader=shader_source(330, "picture_fragment")
        )
        content = [(self._vertices, "3f4", "vertex"), (self._normals, "3f4", "normal"), (self._paint, "4f4", "paint")]
        triangles = context.buffer(np.ascontiguousarray(model.triangles))
        self._mesh = context.vertex_array(self._program, content, triangles)
        self._targets = lru_cache(SIZES_KEPT)(self._make)

    def draw(
        self,
        vertices: Float32[ndarray, "v 3"],
        camera: Camera,
        appearance: PlainAppearance,
        background: UInt8[ndarray, "h w 3"],
    ) -> UInt8[ndarray, "h w 3"]:
        """Draws the head over a background (sRGB).

        Raises:
            DegenerateGeometryError: The camera flattens space, or part of the face is behind a pinhole.
        """
        height, width = background.shape[:2]
        depth = project_homogeneous(camera.matrix, vertices)[:, 2]
        clip_from_model = clip_transform(camera, float(depth.min()), float(np.ptp(depth)), height, width)
        self._vertices.write(np.ascontiguousarray(vertices))
        self._normals.write(self._surface.normals(vertices))
        self._paint.write(vertex_paint(appearance, self._surface))
        self._program["clip_from_model"] = tuple(clip_from_model.T.ravel())
        _light(self._program, appearance, camera)
        fine = height * PICTURE_OVERSAMPLING, width * PICTURE_OVERSAMPLING
        target = self._targets(*fine)
        target.use()
        target.clear()
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.front_face = "cw" if handedness(camera) > 0 else "ccw"
        self._mesh.render(moderngl.TRIANGLES)
        drawn = np.frombuffer(target.read(components=4), dtype=np.uint8).reshape(*fine, 4)
        rgba = cv2.resize(drawn, (width, height), interpolation=cv2.INTER_AREA)
        uncovered = background * (1 - rgba[..., 3:] * np.float32(1 / 255))
        return np.clip(rgba[..., :3] + uncovered + 0.5, 0, 255).astype(np.uint8)

    def _make(self, height: int, width: int) -> moderngl.Framebuffer:
        size = (width, height)
        depth = self._context.depth_renderbuffer(size)
        return self._context.framebuffer([self._context.renderbuffer(size, 4)], depth)


def _light(program: moderngl.Program, appearance: PlainAppearance, camera: Camera) -> None:
    directions, colours = lights_in_model(appearance, camera)
    program["light_directions"], program["light_colours"] = directions.tolist(), colours.tolist()
    program["ambient"] = appearance.ambient_rgb
    program["shine"] = appearance.shine
    towards_camera = -camera.matrix[2, :3] / np.linalg.norm(camera.matrix[2, :3])
    program["towards_camera"] = tuple(towards_camera)
