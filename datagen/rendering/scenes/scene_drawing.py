"""Draws a scene: a head and everything around it, lit, with shadows, and what each pixel shows.

The order of the steps costs least where the processor draws. There the set-up of triangles is expensive, triangles of
a face are smaller than a pixel, and each triangle in a block of pixels would shade the whole block.

1. A depth map from each light, of a coarser head and of the objects.
2. What is seen: which triangle of the head, or which kind of object, at three samples a pixel in each direction.
3. Edges: where two surfaces share a pixel.
4. What is transparent, from far to near.
5. The head, shaded once for each pixel from the triangle at its centre, where hair does not hide it.
6. Opaque objects, once for each pixel.
7. The picture: at an edge, each sample takes the colour of the pixel beside it that shows the same surface.

Steps 2, 3 and 7, and the opaque part of step 1, are done without OpenGL.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from typing import Any, final

import moderngl
import numpy as np
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray

from datagen.appearance.scene import SCENE_LABELS, Scene, ScenePicture, Texture, UniformValue
from datagen.opengl.gl_context import GLContext
from datagen.rendering.gl_mesh import SIZES_KEPT
from datagen.rendering.processor.scene_edges import SceneEdges, find_edges, resolve, shown_kinds
from datagen.rendering.scenes.scene_camera import view_scene
from datagen.rendering.scenes.scene_head import SceneHead
from datagen.rendering.scenes.scene_meshes import ObjectMeshes, Run, Window
from datagen.rendering.scenes.scene_openings import Openings
from datagen.rendering.scenes.scene_program import (
    HEAD_KINDS,
    UNITS,
    SceneProgram,
    SceneTextures,
    compile_programs,
    is_ordinary,
    set_uniforms,
    used_programs,
)
from datagen.rendering.scenes.scene_shadows import SKY, Mesh, ShadowMaps
from datagen.rendering.scenes.scene_targets import SceneTarget, make_target
from datagen.rendering.scenes.scene_visibility import see_scene
from pix2face.geometry.camera import Camera
from pix2face.models.morphable_model import MorphableModel


@final
class SceneDrawer:
    """Draws scenes with heads of one model. OpenGL is made current whenever something is drawn.

    Textures are of all parts, by the name of the sampler; paint and occlusion are those of `SceneHead`.

    Raises:
        UsageError: Paint or a texture has the wrong size or kind.
    """

    def __init__(
        self,
        model: MorphableModel,
        gl: GLContext,
        textures: Mapping[str, Texture],
        head_paint: Float32[ndarray, "v 8"],
        occlusion: Float32[ndarray, " v"],
    ) -> None:
        gl.make_current()
        self._gl = gl
        context = self._context = gl.context
        self._textures = SceneTextures(textures, context)
        self._head = SceneHead(model, context, head_paint, occlusion)
        self._openings = Openings(model)
        self._shadows = ShadowMaps(context, UNITS["shadow_maps"])
        self._targets = lru_cache(SIZES_KEPT)(partial(make_target, context))
        self._variants = lru_cache(2)(self._compiled)
        self._programs, self._objects, self._whole = self._variants(True)

    def draw(self, scene: Scene, camera: Camera, height: int, width: int) -> ScenePicture:
        """Draws a scene as the camera sees it, in a picture of this height and width.

        Raises:
            DegenerateGeometryError: The camera flattens space.
            UsageError: A mesh or a uniform has the wrong size.
            GLUnavailableError: The driver reports an error.
        """
        self._gl.make_current()
        uniforms = view_scene(scene, camera, height, width)
        self._programs, self._objects, self._whole = self._variants(is_ordinary(scene.uniforms))
        self._head.load(scene.head)
        self._objects.load(scene.meshes)
        self._textures.bind()
        target = self._targets(height, width)
        used = used_programs(self._programs, self._objects.kinds(scene.meshes))
        programs = list(used.values())
        set_uniforms(programs, scene.uniforms)
        set_uniforms(programs, self._draw_shadows(scene, used))
        set_uniforms(programs, uniforms)
        samples = self._see(scene, camera, height, width)
        edges = self._find_edges(samples, uniforms)
        target.clear(edges)
        window = Window(np.asarray(uniforms["clip_from_model"]), edges.farther)
        over, over_labels = self._draw_blended(scene, self._objects.blended(window, camera.matrix[2]), target)
        colours = self._draw_opaque(scene, shown_kinds(edges.kind, over), target)
        picture, labels = resolve(samples, edges.middle, colours, over, over_labels)
        self._gl.check()
        return ScenePicture(radiance=picture[..., :3], coverage=np.clip(picture[..., 3], 0, 1), labels=labels)

    def _compiled(
        self, for_ordinary: bool
    ) -> tuple[dict[str, SceneProgram], ObjectMeshes, dict[str, moderngl.VertexArray]]:
        """Programs, and what they draw: objects, and one triangle over the whole picture for each of `HEAD_KINDS`."""
        programs = compile_programs(self._context, for_ordinary=for_ordinary)
        set_uniforms(list(programs.values()), self._textures.units)
        drawn = {name: program for name, program in programs.items() if "vertex" in program.attributes}
        whole = {name: self._context.vertex_array(programs[name].program, []) for name in HEAD_KINDS}
        return programs, ObjectMeshes(self._context, drawn), whole

    def _draw_shadows(self, scene: Scene, used: Mapping[str, SceneProgram]) -> dict[str, UniformValue]:
        """Step 1. Returns the uniforms of the shadow maps."""
        shadowing = [program for name, program in used.items() if name.endswith(" object_shadow")]
        # What lies around the neck (the lowest 50 mm) and lower takes the sky from little but itself.
        chest = float(scene.head.vertices[:, 1].min()) + 50.0
        high = [float(mesh.vertices[:, 1].max(initial=-np.inf)) > chest for mesh in scene.meshes]
        casts = {place for place, mesh in enumerate(scene.meshes) if mesh.casts_shadow}
        opaque = [run.mesh for run in self._objects.opaque if run.mesh in casts]

        chosen, triangles = self._head.coarse
        head = scene.head.vertices.take(chosen, axis=0), triangles

        def solid(light: int) -> list[Mesh]:
            seen = [scene.meshes[place] for place in opaque if light != SKY or high[place]]
            return [head, *((mesh.vertices, mesh.triangles) for mesh in seen)]

        def soft(window: Window, towards_light: Float64[ndarray, "3"]) -> None:
            place = np.append(towards_light, 0)
            set_uniforms(shadowing, {"clip_from_model": window.clip_from_model, "camera_place": place})
            self._context.enable_only(moderngl.DEPTH_TEST)
            for run in self._objects.soft(window, casts):
                self._draw_run(scene, run, "object_shadow")

        return self._shadows.draw(scene.head.vertices, scene.lights, solid, soft)

    def _see(self, scene: Scene, camera: Camera, height: int, width: int) -> Float32[ndarray, "H W 2"]:
        """Step 2."""
        head = scene.head.vertices, self._head.triangles
        objects = [scene.meshes[run.mesh] for run in self._objects.opaque]
        backs = self._openings.box(scene.head.vertices, camera, height, width)
        return see_scene(head, objects, camera, (height, width), backs)

    def _find_edges(self, samples: Float32[ndarray, "H W 2"], uniforms: Mapping[str, Any]) -> SceneEdges:
        """Step 3."""
        return SceneEdges(*find_edges(samples, self._head.kinds, uniforms["depth_from_buffer"], uniforms["edge_mm"]))

    def _draw_blended(
        self, scene: Scene, runs: Sequence[Run], target: SceneTarget
    ) -> tuple[tuple[Float32[ndarray, "h w 4"], Float32[ndarray, "h w 4"]], UInt8[ndarray, "h w"]]:
        """Step 4. Returns what is over the nearer and over the farther surface, and the labels."""
        context = self._context
        target.blended.depth_mask = False
        target.blended.use()
        context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        context.depth_func = "<="
        context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        for run in runs:
            self._draw_run(scene, run, "blended")
        context.depth_func = "<"
        return target.read_blended()

    def _draw_opaque(
        self, scene: Scene, kinds: Float32[ndarray, "h w"], target: SceneTarget
    ) -> Float32[ndarray, "h w 4"]:
        """Steps 5 and 6. The depth test skips pixels that another program paints or that are hidden."""
        self._context.enable_only(moderngl.DEPTH_TEST)
        target.depths["kinds"].write(kinds)
        target.kinds.depth_mask = False
        target.kinds.use()
        for kind in HEAD_KINDS:
            self._whole[kind].render(moderngl.TRIANGLES, vertices=3)
        target.colours.use()
        for run in self._objects.opaque:
            self._draw_run(scene, run, "object")
        return target.read_colours()

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
                "material_texture": UNITS["no_texture"] if unit is None else unit,
                "has_texture": unit is not None,
                "label": SCENE_LABELS.index(mesh.label) / 255,
            }
        )
        self._objects.draw(name, run)
