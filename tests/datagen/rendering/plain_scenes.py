"""Scenes with plain shaders in place of skin, light and hair: what the drawer does is seen as it is."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any
from unittest import mock

import numpy as np
import trimesh
from numpy import ndarray

from datagen.appearance.scene import Material, PosedHead, Scene, SceneMesh, Surface, Texture
from datagen.opengl.gl_context import GLContext
from datagen.rendering.gl_mesh import shader_source
from datagen.rendering.scenes import scene_program
from datagen.rendering.scenes.scene_drawing import SceneDrawer
from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    Pinhole,
    WeakPerspective,
    pinhole_camera,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.models.morphable_model import MorphableModel

LAMBERT = """
vec3 light(Surface s, vec3 towards_camera) {
    return s.albedo * (0.2 + 0.8 * max(dot(s.normal, shadow_lights[0]), 0.0) * shadow(0, s.position, s.smooth_normal));
}
vec3 mirrored(vec3 direction) { return vec3(0.0); }
"""
# The colour as it is; red: what arrives of the first light, green: of the sky.
FLAT = "vec3 light(Surface s, vec3 towards_camera) { return s.albedo; }\nvec3 mirrored(vec3 d) { return vec3(0.0); }"
SHADOWS = """
vec3 light(Surface s, vec3 towards_camera) {
    return vec3(shadow(0, s.position, s.smooth_normal), sky(s.position, s.smooth_normal),
                dot(s.smooth_normal, shadow_lights[0]));
}
vec3 mirrored(vec3 direction) { return vec3(0.0); }
"""
PLAIN = {
    "skin": "Surface skin(Surface s, vec2 uv, vec3 place, vec4 paint0, vec4 paint1, float pixel_mm) {\n"
    "    s.albedo = paint0.rgb; return s; }",
    "hair": "Surface hair_material(Surface s, vec2 uv) { s.alpha *= has_texture ? "
    "texture(material_texture, vec3(uv, float(material_layer))).a : 1.0; return s; }",
    "material": "Surface object_material(Surface s, vec2 uv) { return s; }\n"
    "Surface glass_material(Surface s, vec2 uv, vec3 towards_camera) { return s; }",
}


@contextmanager
def plain_drawer(
    model: MorphableModel,
    gl: GLContext,
    light: str = FLAT,
    textures: Mapping[str, Texture] | None = None,
    paint: ndarray | None = None,
) -> Iterator[SceneDrawer]:
    """A drawer whose light and materials are those above; the head has colour (0.5, 0.5, 0.5)."""
    bodies = {**PLAIN, "light": light}

    def replaced(version: int, *names: str) -> str:
        parts = [bodies.get(name) or shader_source(version, name).partition("\n")[2] for name in names]
        source = "\n".join([f"#version {version} core", *parts])
        return source.replace("INSIDE = 0.3", "INSIDE = 1.0")  # one colour on both sides

    n_vertices = len(model.mean)
    if paint is None:
        paint = np.full((n_vertices, 8), 0.5, dtype=np.float32)
    with mock.patch.object(scene_program, "shader_source", replaced):
        drawer = SceneDrawer(model, gl, textures or {}, paint, np.ones(n_vertices, dtype=np.float32))
    yield drawer


def head_of(model: MorphableModel, vertices: ndarray | None = None) -> PosedHead:
    vertices = model.mean if vertices is None else vertices
    return PosedHead(model=model, vertices=vertices, normals=Surface(model).normals(vertices), neutral=model.mean)


def scene_of(
    model: MorphableModel, meshes: Sequence[SceneMesh] = (), lights: Any = (), vertices: ndarray | None = None
) -> Scene:
    directions = np.asarray(lights, dtype=np.float32).reshape(-1, 3)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Scene(head=head_of(model, vertices), meshes=meshes, uniforms={}, lights=directions)


def camera_at(
    yaw_deg: float = 0,
    pitch_deg: float = 0,
    size: int = 64,
    distance_mm: float | None = None,
    px_per_mm: float = 0.0038,
) -> Camera:
    """The head in the middle of a picture; px_per_mm for a picture of one pixel."""
    rotation = rotation_of_pose(HeadPose(pitch_deg, yaw_deg, 0))
    middle, scale = np.full(2, size / 2), px_per_mm * size
    if distance_mm is None:
        return weak_perspective_camera(WeakPerspective(scale, rotation, middle))
    return pinhole_camera(Pinhole(scale * distance_mm, middle, rotation, np.array([0.0, 0.0, distance_mm])))


def ball(
    centre: Sequence[float], radius: float, label: str = "occluder", *, casts_shadow: bool = True, **material: Any
) -> SceneMesh:
    sphere = trimesh.creation.icosphere(subdivisions=3)
    normals = sphere.vertices.astype(np.float32)
    return SceneMesh(
        name=f"test/{label}",
        label=label,
        vertices=(normals * radius + np.asarray(centre)).astype(np.float32),
        triangles=sphere.faces.astype(np.int32),
        uv=np.ascontiguousarray(0.5 + 0.5 * normals[:, :2]),
        normals=normals,
        material=Material(**{"kind": "object", **material}),
        casts_shadow=casts_shadow,
    )


def sheet(
    z: float,
    extent: tuple[float, float, float, float] = (-150, 150, -150, 150),
    label: str = "glasses",
    **material: Any,
) -> SceneMesh:
    """A square that faces a frontal camera: x and y from, to."""
    left, right, low, high = extent
    corners = np.array([[left, low, z], [right, low, z], [right, high, z], [left, high, z]], dtype=np.float32)
    return SceneMesh(
        name=f"test/{label}",
        label=label,
        vertices=corners,
        triangles=np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
        uv=np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=np.float32),
        normals=np.tile(np.array([0, 0, 1], dtype=np.float32), (4, 1)),
        material=Material(**{"kind": "glass", "is_blended": True, **material}),
    )
