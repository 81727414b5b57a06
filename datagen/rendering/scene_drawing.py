"""Draws a scene: a head and everything around it, lit, with shadows, and what each pixel shows."""

from collections.abc import Mapping
from typing import final

import moderngl
import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from datagen.appearance.scene import SCENE_LABELS, Scene, ScenePicture, Texture, UniformValue
from datagen.opengl.gl_context import GLContext
from datagen.rendering.clip_space import ClipTransform, clip_transform_of_depths
from datagen.rendering.gl_mesh import KeptBySize
from datagen.rendering.scene_meshes import HeadMesh, ObjectMeshes, Run
from datagen.rendering.scene_program import (
    KINDS,
    SceneProgram,
    SceneTextures,
    compile_head,
    compile_label,
    compile_object,
)
from datagen.rendering.scene_shadows import LightView, ShadowMaps
from datagen.rendering.scene_targets import SceneTarget, make_target
from pix2face.camera import Camera
from pix2face.errors import GLUnavailableError
from pix2face.morphable_model import MorphableModel

SHADOW_UNIT, FIRST_TEXTURE_UNIT = 0, 1
# Of a pinhole: what is nearer is cut off, mm.
NEAREST_MM = 10.0
HEAD = SCENE_LABELS.index("head")


@final
class SceneDrawer:
    """Draws scenes with heads of one model.

    Args:
        model: Triangles and texture coordinates.
        gl: Where to draw. It is made current whenever something is drawn.
        textures: Of all parts, by the sampler's name.
        head_paint: Eight numbers for each vertex, for ``skin.glsl``.
        occlusion: How much ambient light arrives at each vertex, 0..1.
        multisampled: Whether edges are smoothed by four samples a pixel, where the driver can; otherwise the picture
            is drawn twice as fine.
    """

    def __init__(
        self,
        model: MorphableModel,
        gl: GLContext,
        textures: Mapping[str, Texture],
        head_paint: Float32[ndarray, "v 8"],
        occlusion: Float32[ndarray, " v"],
        *,
        multisampled: bool = True,
    ) -> None:
        gl.make_current()
        self._gl = gl
        context = self._context = gl.context
        self._textures = SceneTextures(textures, context, FIRST_TEXTURE_UNIT)
        self._paint, self._bare = compile_head(context), compile_label(context)
        self._programs: dict[str, SceneProgram] = {}
        for kind in KINDS:
            self._programs[f"{kind} colour"] = compile_object(context, kind, "object_fragment")
            self._programs[f"{kind} label"] = compile_object(context, kind, "object_label_fragment")
        self._head = HeadMesh(model, context, head_paint, occlusion)
        self._painted_head, self._bare_head = self._head.painted(self._paint), self._head.bare(self._bare)
        self._objects = ObjectMeshes(context, self._programs)
        self._shadows = ShadowMaps(context, SHADOW_UNIT)
        self._targets = KeptBySize(
            lambda height, width: make_target(context, height, width, multisampled), SceneTarget.release
        )
        for program in self._all_programs():
            program.set(dict(self._textures.units))

    def draw(self, scene: Scene, camera: Camera, height: int, width: int) -> ScenePicture:
        """Draws a scene.

        Args:
            scene: What stands before the camera.
            camera: From the model frame to the picture.
            height: Rows of the picture.
            width: Its columns.

        Raises:
            DegenerateGeometryError: The camera flattens space.
            UsageError: A mesh or a uniform has the wrong size.
            GLUnavailableError: The driver reports an error.
        """
        self._gl.make_current()
        self._head.load(scene.head)
        self._objects.load(scene.meshes, camera.matrix[2])
        self._textures.bind()
        transform = clip_transform_of_depths(camera, *_depth_range(scene, camera), height, width)
        lighting = self._draw_shadows(scene)
        seen = {**scene.uniforms, **lighting, **_camera_uniforms(camera)}
        seen["clip_from_model"] = transform.clip_from_model
        for program in self._all_programs():
            program.set(seen)
        target = self._targets.get(height, width)
        self._draw_colours(scene, transform, target)
        self._draw_labels(scene, target)
        colours, labels = target.read_colours(self._context), target.read_labels()
        self._check()
        return ScenePicture(radiance=colours[..., :3], coverage=np.clip(colours[..., 3], 0, 1), labels=labels)

    def release(self) -> None:
        """Gives everything back to the driver."""
        self._gl.make_current()
        self._targets.release_all()
        for each in (self._objects, self._head, self._shadows, self._textures):
            each.release()
        for program in self._all_programs():
            program.program.release()

    def _all_programs(self) -> tuple[SceneProgram, ...]:
        return (self._paint, self._bare, *self._programs.values())

    def _draw_shadows(self, scene: Scene) -> dict[str, UniformValue]:
        """Draws what each light sees of what casts shadows."""

        def casters(view: LightView, towards_light: Float64[ndarray, "3"]) -> None:
            seen: dict[str, UniformValue] = {
                **scene.uniforms,
                "clip_from_model": view.clip_from_model,
                "camera_place": np.append(towards_light, 0),
            }
            for program in (self._bare, *(self._programs[f"{kind} label"] for kind in KINDS)):
                program.set(seen)
            self._bare_head.render(moderngl.TRIANGLES)
            for run in (*self._objects.opaque, *self._objects.blended):
                if scene.meshes[run.mesh].casts_shadow:
                    self._draw_run(scene, run, "label")

        self._context.enable_only(moderngl.DEPTH_TEST)
        return self._shadows.draw(scene.head.vertices, scene.lights, casters)

    def _draw_colours(self, scene: Scene, transform: ClipTransform, target: SceneTarget) -> None:
        """Everything opaque, then the rest from far to near."""
        context, framebuffer = self._context, target.colours
        framebuffer.depth_mask = True
        framebuffer.use()
        framebuffer.clear()
        context.enable_only(moderngl.DEPTH_TEST)
        context.front_face = "cw" if transform.outside_is_clockwise else "ccw"
        for run in self._objects.opaque:
            self._draw_run(scene, run, "colour")
        self._painted_head.render(moderngl.TRIANGLES)
        if self._objects.blended:
            framebuffer.depth_mask = False
            framebuffer.use()
            context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
            context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
            for run in self._objects.blended:
                self._draw_run(scene, run, "colour")
            framebuffer.depth_mask = True

    def _draw_labels(self, scene: Scene, target: SceneTarget) -> None:
        """What is nearest at the centre of each pixel and more opaque than not."""
        target.labels.use()
        target.labels.clear()
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._bare.set({"label": HEAD / 255})
        self._bare_head.render(moderngl.TRIANGLES)
        for run in (*self._objects.opaque, *self._objects.blended):
            self._draw_run(scene, run, "label")

    def _draw_run(self, scene: Scene, run: Run, purpose: str) -> None:
        """Draws some triangles of an object in its material."""
        mesh = scene.meshes[run.mesh]
        material = mesh.material
        name = f"{material.kind} {purpose}"
        unit = self._textures.units.get(material.texture)
        self._programs[name].set(
            {
                "material_colour": material.colour,
                "material_alpha": material.alpha,
                "material_roughness": material.roughness,
                "material_reflectance": material.reflectance,
                "material_numbers": material.numbers,
                "material_layer": material.layer,
                "material_texture": FIRST_TEXTURE_UNIT if unit is None else unit,
                "has_texture": unit is not None,
                "is_blended": material.is_blended,
                "label": SCENE_LABELS.index(mesh.label) / 255,
            }
        )
        self._objects.draw(name, run)

    def _check(self) -> None:
        error = self._context.error
        if error != "GL_NO_ERROR":
            raise GLUnavailableError(
                f"expected {self._gl.renderer} to draw a scene, found {error}; is its memory full?"
            )


def _depth_range(scene: Scene, camera: Camera) -> tuple[float, float]:
    """Nearest depth and extent of all that is drawn, mm; of a pinhole, what is before it."""
    depths = [
        camera.depth(points)
        for points in (scene.head.vertices, *(mesh.vertices for mesh in scene.meshes))
        if len(points)
    ]
    low, high = min(float(depth.min()) for depth in depths), max(float(depth.max()) for depth in depths)
    if not camera.is_affine:
        low = max(low, NEAREST_MM)
    return low, max(high - low, 1.0)


def _camera_uniforms(camera: Camera) -> dict[str, UniformValue]:
    """Where the camera is, and how large its pixels are."""
    rows = camera.matrix
    # Pixels per mm across, at w = 1: the root of the area that a square mm takes.
    direction = rows[2, :3] / np.linalg.norm(rows[2, :3])
    scale = float(np.sqrt(np.linalg.norm(np.cross(*(row - (row @ direction) * direction for row in rows[:2, :3])))))
    if camera.is_affine:
        place = np.append(-direction, 0.0)
    else:
        place = np.append(-np.linalg.solve(rows[[0, 1, 3], :3], rows[[0, 1, 3], 3]), 1.0)
    return {"camera_place": place, "pixel_mm_at_1": 1 / max(scale, 1e-9)}
