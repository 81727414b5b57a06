"""Draws what ``skin.glsl`` paints on a head: the scene drawer with a light that shows the surface as it is."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import final
from unittest import mock

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.scene import PosedHead, Scene, Surface, UniformValue
from datagen.appearance.skin.skin import Skin
from datagen.appearance.skin.skin_textures import skin_textures
from datagen.appearance.skin.uniforms import skin_uniforms
from datagen.appearance.skin.zones import head_paint
from datagen.opengl.gl_context import GLContext
from datagen.rendering.gl_mesh import shader_source
from datagen.rendering.scenes import scene_program
from datagen.rendering.scenes.scene_drawing import SceneDrawer
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.models.morphable_model import MorphableModel

# What is drawn in place of lit skin.
ALBEDO = "s.albedo"
RELIEF = "vec3(length(s.normal - s.smooth_normal), s.roughness, s.scatter)"
_OTHER_PARTS = {
    "hair": "Surface hair_material(Surface s, vec2 uv) { return s; }",
    "material": "Surface object_material(Surface s, vec2 uv) { return s; }\n"
    "Surface glass_material(Surface s, vec2 uv, vec3 towards_camera) { return s; }",
}


@final
@dataclass(frozen=True)
class PaintedSkin:
    """A drawer of painted heads of one model."""

    model: MorphableModel
    surface: Surface
    drawer: SceneDrawer

    def draw(
        self,
        skin: Skin,
        expression: Mapping[str, float] | None = None,
        yaw_deg: float = 0.0,
        window_mm: tuple[float, float, float] = (0.0, 10.0, 110.0),
        changed: Mapping[str, UniformValue] | None = None,
    ) -> tuple[Float32[ndarray, "256 256 3"], Float32[ndarray, "256 256"]]:
        """What the light shows, and coverage; the window is its middle (x, y) and half of its side."""
        active = dict(expression or {})
        named, n_identity = self.model.named_expressions, self.model.n_identity
        coefficients = sum((named[name] * value for name, value in active.items()), np.zeros(self.model.n_expression))
        vertices = self.model.vertices(np.zeros((1, n_identity)), np.asarray(coefficients)[None])[0]
        normals = self.surface.normals(vertices)
        head = PosedHead(
            model=self.model, vertices=vertices, normals=normals, neutral=vertices, named_expressions=active
        )
        uniforms = {**skin_uniforms(skin, head), **(changed or {})}
        scene = Scene(head=head, meshes=(), uniforms=uniforms, lights=np.zeros((0, 3), dtype=np.float32))
        rotation = rotation_of_pose(HeadPose(yaw_deg=yaw_deg, pitch_deg=0.0, roll_deg=0.0))
        x, y, half = window_mm
        scale = 128 / half
        middle = np.array([128.0, 128.0]) - scale * (rotation @ np.array([x, y, 0.0]))[:2]
        camera = weak_perspective_camera(WeakPerspective(rotation=rotation, scale=scale, translation_px=middle))
        picture = self.drawer.draw(scene, camera, 256, 256)
        return picture.radiance / np.maximum(picture.coverage[..., None], 1e-3), picture.coverage


@contextmanager
def painted_skin(
    model: MorphableModel, gl: GLContext, shown: str = ALBEDO, others: Mapping[str, str] | None = None
) -> Iterator[PaintedSkin]:
    """A drawer that shows ``ALBEDO`` or ``RELIEF``; ``others`` are shaders in place of the project's."""
    light = f"vec3 light(Surface s, vec3 towards_camera) {{ return {shown}; }}\n"
    bodies = {**_OTHER_PARTS, "light": light + "vec3 mirrored(vec3 direction) { return vec3(0.0); }", **(others or {})}

    def replaced(version: int, *names: str) -> str:
        parts = [bodies.get(name) or shader_source(version, name).partition("\n")[2] for name in names]
        return "\n".join([f"#version {version} core", *parts])

    open_to_sky = np.ones(len(model.mean), dtype=np.float32)
    with mock.patch.object(scene_program, "shader_source", replaced):
        drawer = SceneDrawer(model, gl, skin_textures(), head_paint(model), open_to_sky)
    yield PaintedSkin(model, Surface(model), drawer)
