"""Draws the components of a morphable model on a contact sheet, or writes its mean face as a mesh."""

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from datagen.appearance.plain_appearance import PlainAppearance
from datagen.opengl.gl_context import create_gl_context
from datagen.rendering.renderer import Renderer
from pix2face.files.images import write_picture
from pix2face.files.writing import write_file
from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.geometry.other_cameras import M_PER_MM
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.surface_attributes import split_at_seams
from pix2face.photographs.mesh_files import material_stem

if TYPE_CHECKING:
    import trimesh

PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png")
MESH_SUFFIXES = (".obj", ".glb", ".ply")
DEVIATIONS = 3.0
TILE_PX = 200
_MARGIN = 1.12
_BACKGROUND, _INK = 245, (60, 60, 60)
_CLAY, _DARKER_CLAY = (0.62, 0.61, 0.60), (0.50, 0.49, 0.48)
_VIEWS = (HeadPose(0, 0, 0), HeadPose(0, 75, 0))
_LABEL_PX = 22
# Grey clay in the light of one lamp, which shows the shape well.
_APPEARANCE = PlainAppearance(
    skin_rgb=_CLAY,
    lips_rgb=_DARKER_CLAY,
    hair_rgb=_CLAY,
    brows_rgb=_DARKER_CLAY,
    iris_rgb=_DARKER_CLAY,
    flush=0.0,
    beard=0.0,
    blotchiness=0.0,
    texture_seed=0,
    ambient_rgb=(0.25, 0.25, 0.25),
    light_directions=((-0.45, -0.5, -0.74),),
    light_rgb=((0.95, 0.95, 0.95),),
    shine=0.04,
    blur_px=0.0,
    noise=0.0,
    noise_seed=0,
)


def write_view(model: MorphableModel, out: Path, n_components: int) -> None:
    """Writes a picture or a mesh of a model.

    Args:
        model: The model.
        out: The file to write, with one of ``PICTURE_SUFFIXES`` (the mean and ±3 standard deviations of the first
            components, from two sides) or of ``MESH_SUFFIXES`` (the mean face: ``.obj`` and ``.ply`` in mm, ``.glb``
            in metres, as glTF requires).
        n_components: Number of identity components and of expression components in a picture.

    Raises:
        OSError: The file cannot be written.
        GLUnavailableError: There is no OpenGL to draw a picture with.
    """
    suffix = out.suffix.lower()
    if suffix in MESH_SUFFIXES:
        import trimesh  # here, since it takes half a second and other commands do not need it

        mesh = mesh_of(model)
        if isinstance(mesh.visual, trimesh.visual.TextureVisuals):
            mesh.visual.material.name = material_stem(out.stem)  # so that each .obj has its own material file
        if suffix == ".glb":
            mesh.vertices = mesh.vertices * M_PER_MM
        if suffix == ".obj":
            material = f"{material_stem(out.stem)}.mtl"
            content, beside = trimesh.exchange.obj.export_obj(mesh, return_texture=True, mtl_name=material)  # type: ignore[no-untyped-call]
            for name, part in beside.items():
                write_file(out.with_name(name), part)
        else:
            content = mesh.export(file_type=suffix.removeprefix("."))
        write_file(out, content)
    else:
        write_picture(out, component_sheet(model, n_components))


def mesh_of(model: MorphableModel) -> "trimesh.Trimesh":
    """Returns the mean face in mm, with the mean albedo as vertex colours, or else with texture coordinates."""
    import trimesh

    if model.albedo_mean is None and model.uv is not None:
        vertex, uv, triangles = split_at_seams(model)
        visual = trimesh.visual.TextureVisuals(uv=uv)  # type: ignore[no-untyped-call]
        return trimesh.Trimesh(model.mean[vertex], triangles, visual=visual, process=False)
    colours = None
    if model.albedo_mean is not None:
        colours = np.clip(255 * model.albedo_mean + 0.5, 0, 255).astype(np.uint8)
    return trimesh.Trimesh(model.mean, model.triangles, vertex_colors=colours, process=False)


def component_sheet(model: MorphableModel, n_components: int) -> UInt8[ndarray, "h w 3"]:
    """Draws one row for the mean and one for each of the first components, from two sides.

    Components are shown at -3 and +3 standard deviations, blendshapes at their full strength.

    Raises:
        GLUnavailableError: There is no OpenGL to draw with.
    """
    rows = [("mean", model.mean[None])]
    rows += [_row(model, "identity", i) for i in range(min(n_components, model.n_identity))]
    rows += [_row(model, "expression", i) for i in range(min(n_components, model.n_expression))]
    with create_gl_context() as gl:
        renderer = Renderer(model, TILE_PX, TILE_PX, gl)
        strips = [_strip(renderer, label, shapes) for label, shapes in rows]
    width = max(strip.shape[1] for strip in strips)
    widened = [np.pad(one, ((0, 0), (0, width - one.shape[1]), (0, 0)), constant_values=_BACKGROUND) for one in strips]
    return np.vstack(widened)


def _row(model: MorphableModel, kind: str, i: int) -> tuple[str, Float32[ndarray, "n v 3"]]:
    """Returns the label and the shapes of one component."""
    component = (model.identity_basis if kind == "identity" else model.expression_basis)[i]
    name = next((name for name, c in model.named_expressions.items() if c[i] == 1 and np.count_nonzero(c) == 1), None)
    if kind == "expression" and name is not None:
        return f"expression {i + 1}: {name}", (model.mean + component)[None]
    steps = np.array([-DEVIATIONS, DEVIATIONS], dtype=np.float32)
    label = f"{kind} {i + 1}: -{DEVIATIONS:g} sd, +{DEVIATIONS:g} sd"
    return label, model.mean + steps[:, None, None] * component


def _strip(renderer: Renderer, label: str, shapes: Float32[ndarray, "n v 3"]) -> UInt8[ndarray, "h w 3"]:
    """Draws shapes in all views, below a title."""
    background = np.full((TILE_PX, TILE_PX, 3), _BACKGROUND, dtype=np.uint8)
    strip = np.hstack(
        [
            renderer.render_image(np.ascontiguousarray(shape), _camera(renderer.model, pose), _APPEARANCE, background)
            for shape in shapes
            for pose in _VIEWS
        ]
    )
    title = np.full((_LABEL_PX, strip.shape[1], 3), _BACKGROUND, dtype=np.uint8)
    cv2.putText(title, label, (8, _LABEL_PX - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
    return np.vstack([title, strip])


def _camera(model: MorphableModel, pose: HeadPose) -> Camera:
    """Returns a camera that shows the whole mean face, at the same scale for all poses."""
    low, high = model.mean.min(axis=0).astype(np.float64), model.mean.max(axis=0).astype(np.float64)
    scale = TILE_PX / (_MARGIN * max(float((high - low).max()), 1e-6))
    rotation = rotation_of_pose(pose)
    centre_px = np.array([TILE_PX / 2, TILE_PX / 2]) - scale * (rotation @ (0.5 * (low + high)))[:2]
    return weak_perspective_camera(WeakPerspective(scale, rotation, centre_px))
