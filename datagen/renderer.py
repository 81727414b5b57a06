"""Draws a posed face with OpenGL: the maps, exactly, and the picture of a face of a model that has no photographs.

Conventions are those of the oracle, ``pix2face.rasterise``: nothing is culled, backs hide but are never face.
"""

from collections import OrderedDict
from importlib.resources import files
from typing import final

import cv2
import moderngl
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from datagen.appearance.plain import PlainAppearance, lights_in_model, vertex_paint
from datagen.appearance.surface import Surface
from datagen.clip_space import ClipTransform, clip_transform
from datagen.gl_context import GLContext
from pix2face.camera import Camera
from pix2face.errors import GLUnavailableError, UsageError
from pix2face.morphable_model import MorphableModel
from pix2face.rasterise import RenderedMaps

# Photographs come in several sizes: the buffers of this many are kept.
SIZES_KEPT = 8

# Pictures (never maps) are drawn this much finer and averaged, so that edges are as smooth as a lens makes them.
PICTURE_OVERSAMPLING = 2


@final
class Renderer:
    """Renders faces of one model in one image size; ``with_size`` shares the uploaded model with another size.

    Args:
        model: Mean, triangles and regions.
        height: Rows of the images.
        width: Columns of the images.
        gl: Where to draw.

    Raises:
        UsageError: The size is not positive, or larger than the driver draws.
    """

    def __init__(self, model: MorphableModel, height: int, width: int, gl: GLContext) -> None:
        self.model = model
        self._scene = _Scene(model, gl)
        self.height, self.width = self._scene.checked_size(height, width)

    def with_size(self, height: int, width: int) -> "Renderer":
        """The same renderer for another size of images; cheap."""
        other = object.__new__(Renderer)
        other.model, other._scene = self.model, self._scene
        other.height, other.width = self._scene.checked_size(height, width)
        return other

    def render(self, vertices: Float32[ndarray, "v 3"], camera: Camera) -> RenderedMaps:
        """Renders PNCC, offset, mask and depth of one face.

        Args:
            vertices: This face, mm, model frame, not posed.
            camera: From the model frame to this image.

        Raises:
            DegenerateGeometryError: The camera flattens space, or part of the face is behind a pinhole.
            GLUnavailableError: The driver reports an error.

        Source: Crispell and Bazik 2017, Sec. 3 (PNCC and offset images).
        """
        transform = clip_transform(camera, vertices, self.height, self.width)
        target = self._scene.target("maps", self.height, self.width)
        program = self._scene.maps_program
        program["depth_from_model"] = tuple(transform.depth_from_model)
        self._scene.draw(self._scene.maps_mesh, target, transform, vertices)
        pncc, offset = (self._read(target, attachment) for attachment in range(2))
        kind, depth = pncc[..., 3], offset[..., 3] + np.float32(transform.nearest_mm)
        mask = kind == 1
        return RenderedMaps(
            pncc=np.ascontiguousarray(pncc[..., :3]),
            offset=np.ascontiguousarray(offset[..., :3]),
            mask=mask,
            depth=np.where(mask, depth, np.float32(0)),
            surface_depth=np.where(kind > 0, depth, np.float32(np.inf)),
        )

    def render_image(
        self,
        vertices: Float32[ndarray, "v 3"],
        camera: Camera,
        appearance: PlainAppearance,
        background: UInt8[ndarray, "h w 3"],
    ) -> UInt8[ndarray, "h w 3"]:
        """Renders the lit, painted head over a background (sRGB), edges smooth.

        Raises:
            DegenerateGeometryError: As ``render``.
            UsageError: The background has another size than the renderer.
        """
        if background.shape[:2] != (self.height, self.width):
            raise UsageError(
                f"expected a background of {self.height} x {self.width} pixels, found {background.shape[:2]}"
            )
        transform = clip_transform(camera, vertices, self.height, self.width)
        scene = self._scene
        scene.upload_paint(vertices, appearance)
        _light(scene.picture_program, appearance, camera)
        fine = self.height * PICTURE_OVERSAMPLING, self.width * PICTURE_OVERSAMPLING
        target = scene.target("picture", *fine)
        scene.draw(scene.picture_mesh, target, transform, vertices)
        drawn = np.frombuffer(target.read(components=4), dtype=np.uint8).reshape(*fine, 4)
        scene.check()
        rgba = cv2.resize(drawn, (self.width, self.height), interpolation=cv2.INTER_AREA)
        uncovered = background * (1 - rgba[..., 3:] * np.float32(1 / 255))
        return np.clip(rgba[..., :3] + uncovered + 0.5, 0, 255).astype(np.uint8)

    def _read(self, target: moderngl.Framebuffer, attachment: int) -> Float32[ndarray, "h w 4"]:
        out = np.empty((self.height, self.width, 4), dtype=np.float32)
        target.read_into(out, components=4, attachment=attachment, dtype="f4")
        self._scene.check()
        return out


@final
class _Scene:
    """What lives in the driver: the mesh, the programs, and framebuffers by size."""

    def __init__(self, model: MorphableModel, gl: GLContext) -> None:
        self._context = gl.context
        self._renderer = gl.renderer
        self._surface = Surface(model)
        self._targets: OrderedDict[tuple[str, int, int], moderngl.Framebuffer] = OrderedDict()
        order = np.argsort(~model.is_face_triangle, kind="stable")  # face first: see maps_fragment.glsl
        n_bytes = model.mean.nbytes
        self._triangles = self._context.buffer(np.ascontiguousarray(model.triangles[order]))
        self._mean = self._context.buffer(np.ascontiguousarray(model.mean))
        self._vertices = self._context.buffer(reserve=n_bytes, dynamic=True)
        self._normals = self._context.buffer(reserve=n_bytes, dynamic=True)
        self._paint = self._context.buffer(reserve=n_bytes // 3 * 4, dynamic=True)
        self.maps_program = self._program("maps")
        self.maps_program["face_triangles"] = int(model.is_face_triangle.sum())
        self.maps_mesh = self._mesh(self.maps_program, {"mean": (self._mean, "3f4")})
        self.picture_program = self._program("picture")
        painted = {"normal": (self._normals, "3f4"), "paint": (self._paint, "4f4")}
        self.picture_mesh = self._mesh(self.picture_program, painted)

    def checked_size(self, height: int, width: int) -> tuple[int, int]:
        """The size, if the driver can draw it."""
        largest = min(self._context.info["GL_MAX_RENDERBUFFER_SIZE"], *self._context.info["GL_MAX_VIEWPORT_DIMS"])
        largest //= PICTURE_OVERSAMPLING
        if not (0 < height <= largest and 0 < width <= largest):
            raise UsageError(
                f"expected images of 1 to {largest} pixels a side ({self._renderer} draws no larger ones), "
                f"found {height} x {width}"
            )
        return height, width

    def target(self, kind: str, height: int, width: int) -> moderngl.Framebuffer:
        """A framebuffer of a size, new or kept."""
        key = (kind, height, width)
        if key not in self._targets:
            while len(self._targets) >= SIZES_KEPT:
                _release_framebuffer(self._targets.popitem(last=False)[1])
            self._targets[key] = self._framebuffer(kind, (width, height))
        self._targets.move_to_end(key)
        return self._targets[key]

    def upload_paint(self, vertices: Float32[ndarray, "v 3"], appearance: PlainAppearance) -> None:
        """Gives the mesh its normals and colours."""
        self._normals.write(self._surface.normals(vertices))
        self._paint.write(vertex_paint(appearance, self._surface))

    def draw(
        self,
        mesh: moderngl.VertexArray,
        target: moderngl.Framebuffer,
        transform: ClipTransform,
        vertices: Float32[ndarray, "v 3"],
    ) -> None:
        """Draws the whole mesh into a cleared framebuffer."""
        self._vertices.write(np.ascontiguousarray(vertices))
        _uniform(mesh.program, "clip_from_model").write(
            np.ascontiguousarray(transform.clip_from_model.T, dtype=np.float32)
        )
        target.use()
        target.clear()
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.front_face = "cw" if transform.outside_is_clockwise else "ccw"
        mesh.render(moderngl.TRIANGLES)

    def check(self) -> None:
        """Raises GLUnavailableError if OpenGL has an error to report."""
        error = self._context.error
        if error != "GL_NO_ERROR":
            raise GLUnavailableError(f"expected {self._renderer} to draw, found {error}; is its memory full?")

    def _framebuffer(self, kind: str, size: tuple[int, int]) -> moderngl.Framebuffer:
        # 24 bits of depth, all that moderngl offers, are steps of some 0.00002 mm over a head.
        depth = self._context.depth_renderbuffer(size)
        if kind == "maps":
            colours = [self._context.renderbuffer(size, 4, dtype="f4") for _ in range(2)]
        else:
            colours = [self._context.renderbuffer(size, 4)]
        return self._context.framebuffer(color_attachments=colours, depth_attachment=depth)

    def _program(self, name: str) -> moderngl.Program:
        shaders = files("datagen") / "shaders"
        return self._context.program(
            vertex_shader=(shaders / f"{name}_vertex.glsl").read_text(encoding="utf-8"),
            fragment_shader=(shaders / f"{name}_fragment.glsl").read_text(encoding="utf-8"),
        )

    def _mesh(
        self, program: moderngl.Program, attributes: dict[str, tuple[moderngl.Buffer, str]]
    ) -> moderngl.VertexArray:
        content = [(self._vertices, "3f4", "vertex")]
        content += [(buffer, layout, name) for name, (buffer, layout) in attributes.items()]
        return self._context.vertex_array(program, content, self._triangles)


def _light(program: moderngl.Program, appearance: PlainAppearance, camera: Camera) -> None:
    directions, colours = lights_in_model(appearance, camera)
    _uniform(program, "light_directions").write(directions)
    _uniform(program, "light_colours").write(colours)
    program["ambient"] = appearance.ambient_rgb
    program["shine"] = appearance.shine
    towards_camera = -camera.matrix[2, :3] / np.linalg.norm(camera.matrix[2, :3])
    program["towards_camera"] = tuple(towards_camera)


def _uniform(program: moderngl.Program, name: str) -> moderngl.Uniform:
    uniform = program[name]
    assert isinstance(uniform, moderngl.Uniform)
    return uniform


def _release_framebuffer(framebuffer: moderngl.Framebuffer) -> None:
    attachments = [*framebuffer.color_attachments, framebuffer.depth_attachment]
    framebuffer.release()
    for attachment in attachments:
        attachment.release()
