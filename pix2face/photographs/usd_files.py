"""Universal Scene Description: stages with a face and a camera, in metres, y up (extra ``usd``, package usd-core).

The camera looks along -z with y up, as in glTF. Lengths of its film and lens are in tenths of the scene's unit, so only
their ratio matters with perspective; without it, they are what the picture shows.

Source: https://openusd.org/release/api/class_usd_geom_camera.html and usd_geom_mesh.html.
"""

import importlib
import math
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.files.images import encode_image, srgb_to_linear
from pix2face.files.writing import written_in_one_step
from pix2face.geometry.other_cameras import M_PER_MM, NEAREST_SEEN_M
from pix2face.models.morphable_model import MorphableModel

HOW_TO_INSTALL = "pip install 'pix2face[usd]'"
FILM_WIDTH: Final = 36.0  # with perspective; programs show lenses as if for this film
LENGTHS_PER_UNIT: Final = 10.0  # of apertures and focal lengths
FARTHEST_SEEN_M: Final = 1e4
STAGE_NAME, TEXTURE_NAME = "face.usdc", "texture.png"


def usd_module(name: str) -> Any:
    """A module of usd-core, such as ``Usd``.

    Raises:
        UsageError: The package is not installed.
    """
    try:
        return importlib.import_module(f"pxr.{name}")
    except ImportError as error:
        raise UsageError(f"expected the package usd-core, which USD needs; run: {HOW_TO_INSTALL}") from error


def new_stage(path: Path, root: str) -> Any:
    """An empty stage in a ``.usdc`` file, with a root that programs load by default."""
    usd, geom, kinds = usd_module("Usd"), usd_module("UsdGeom"), usd_module("Kind")
    stage = usd.Stage.CreateNew(str(path))
    geom.SetStageUpAxis(stage, geom.Tokens.y)
    geom.SetStageMetersPerUnit(stage, geom.LinearUnits.meters)
    prim = geom.Xform.Define(stage, root).GetPrim()
    usd.ModelAPI(prim).SetKind(kinds.Tokens.component)
    stage.SetDefaultPrim(prim)
    return stage


def add_mesh(stage: Any, path: str, model: MorphableModel) -> Any:
    """A mesh of the model's triangles, which has no points yet. It is no control mesh of a smoother surface."""
    geom, values = usd_module("UsdGeom"), usd_module("Vt")
    mesh = geom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr(geom.Tokens.none)
    mesh.CreateFaceVertexCountsAttr(values.IntArray(len(model.triangles), 3))
    mesh.CreateFaceVertexIndicesAttr(values.IntArray.FromNumpy(np.ascontiguousarray(model.triangles).reshape(-1)))
    return mesh


def set_points(mesh: Any, points_m: Float[ndarray, "v 3"], time_code: float | None = None) -> None:
    """Sets the points of a mesh and the box around them, at a time or for all times."""
    values, usd = usd_module("Vt"), usd_module("Usd")
    when = usd.TimeCode.Default() if time_code is None else usd.TimeCode(time_code)
    points = np.ascontiguousarray(points_m, dtype=np.float32)
    mesh.CreatePointsAttr().Set(values.Vec3fArray.FromNumpy(points), when)
    box = np.stack([points.min(axis=0), points.max(axis=0)])
    mesh.CreateExtentAttr().Set(values.Vec3fArray.FromNumpy(box), when)


def add_orthographic_camera(stage: Any, path: str, width_m: float, height_m: float, farthest_m: float) -> Any:
    """A camera without perspective, which shows so much of the scene."""
    camera = _add_camera(stage, path, "orthographic", farthest_m)
    camera.CreateHorizontalApertureAttr(width_m * LENGTHS_PER_UNIT)
    camera.CreateVerticalApertureAttr(height_m * LENGTHS_PER_UNIT)
    return camera


def add_perspective_camera(stage: Any, path: str, width_per_height: float) -> Any:
    """A camera with perspective, whose focal length is still to be set: ``film_focal`` gives it."""
    camera = _add_camera(stage, path, "perspective", FARTHEST_SEEN_M)
    camera.CreateHorizontalApertureAttr(FILM_WIDTH)
    camera.CreateVerticalApertureAttr(FILM_WIDTH / width_per_height)
    return camera


def film_focal(focal: float, width: float) -> float:
    """A focal length in the unit of the film, from one in any unit and the width of the picture in the same."""
    return focal / width * FILM_WIDTH


def _add_camera(stage: Any, path: str, projection: str, farthest_m: float) -> Any:
    camera = usd_module("UsdGeom").Camera.Define(stage, path)
    camera.CreateProjectionAttr(projection)
    camera.CreateClippingRangeAttr(usd_module("Gf").Vec2f(NEAREST_SEEN_M, farthest_m))
    return camera


def write_face_usdz(
    path: Path,
    vertices: Float[ndarray, "v 3"],
    model: MorphableModel,
    vertex_colours: UInt8[ndarray, "v 3"] | None = None,
    texture: UInt8[ndarray, "s s 3"] | None = None,
    camera: Mapping[str, Any] | None = None,
) -> None:
    """Writes a face (mm, model frame) in one file, with its colours or its texture, and the camera of its photograph.

    Raises:
        UsageError: usd-core is not installed.
    """
    archives = usd_module("Sdf").ZipFileWriter
    with TemporaryDirectory() as name, written_in_one_step(path) as unfinished:
        folder = Path(name)
        stage = new_stage(folder / STAGE_NAME, "/face")
        mesh = add_mesh(stage, "/face/mesh", model)
        set_points(mesh, vertices * M_PER_MM)
        if texture is not None:
            (folder / TEXTURE_NAME).write_bytes(encode_image(texture))
            _bind_texture(stage, mesh, model)
        elif vertex_colours is not None:
            linear = srgb_to_linear(vertex_colours / 255).astype(np.float32)
            colours = mesh.CreateDisplayColorPrimvar(usd_module("UsdGeom").Tokens.vertex)
            colours.Set(usd_module("Vt").Vec3fArray.FromNumpy(linear))
        if camera is not None:
            _add_photograph(stage, camera)
        stage.GetRootLayer().Save()
        archive = archives.CreateNew(str(unfinished))
        for part in (STAGE_NAME, TEXTURE_NAME):  # the stage comes first
            if (folder / part).exists():
                archive.AddFile(str(folder / part), part)
        archive.Save()


def _add_photograph(stage: Any, form: Mapping[str, Any]) -> None:
    lens = form["camera"]
    if lens["type"] == "perspective":
        aspect, field_of_view = lens["perspective"]["aspectRatio"], lens["perspective"]["yfov"]
        camera = add_perspective_camera(stage, "/face/photograph", aspect)
        camera.CreateFocalLengthAttr(film_focal(0.5 / math.tan(field_of_view / 2), aspect))
    else:
        own = lens["orthographic"]
        camera = add_orthographic_camera(stage, "/face/photograph", 2 * own["xmag"], 2 * own["ymag"], own["zfar"])
    matrix = usd_module("Gf").Matrix4d(*form["matrix"])  # both by columns, as row vectors are multiplied from the left
    camera.AddTransformOp().Set(matrix)


def _bind_texture(stage: Any, mesh: Any, model: MorphableModel) -> None:
    """A material with the texture, whose coordinates split at seams without splitting vertices."""
    geom, shade, types = usd_module("UsdGeom"), usd_module("UsdShade"), usd_module("Sdf").ValueTypeNames
    values = usd_module("Vt")
    assert model.uv is not None
    assert model.uv_triangles is not None
    coordinates = geom.PrimvarsAPI(mesh).CreatePrimvar("st", types.TexCoord2fArray, geom.Tokens.faceVarying)
    coordinates.Set(values.Vec2fArray.FromNumpy(np.ascontiguousarray(model.uv, dtype=np.float32)))
    coordinates.SetIndices(values.IntArray.FromNumpy(np.ascontiguousarray(model.uv_triangles).reshape(-1)))

    def shader(name: str, kind: str) -> Any:
        own = shade.Shader.Define(stage, f"/face/material/{name}")
        own.CreateIdAttr(kind)
        return own

    material = shade.Material.Define(stage, "/face/material")
    reader = shader("coordinates", "UsdPrimvarReader_float2")
    reader.CreateInput("varname", types.String).Set("st")
    picture = shader("texture", "UsdUVTexture")
    picture.CreateInput("file", types.Asset).Set(TEXTURE_NAME)
    picture.CreateInput("sourceColorSpace", types.Token).Set("sRGB")
    picture.CreateInput("st", types.Float2).ConnectToSource(reader.CreateOutput("result", types.Float2))
    surface = shader("surface", "UsdPreviewSurface")
    surface.CreateInput("roughness", types.Float).Set(1.0)
    colour = picture.CreateOutput("rgb", types.Float3)
    surface.CreateInput("diffuseColor", types.Color3f).ConnectToSource(colour)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", types.Token))
    shade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
