"""Fitted meshes as ``.obj``, ``.ply``, ``.glb`` and ``.usdz``, with colours per vertex or a texture.

Layouts: docs/reference. All are in the model frame: x to the subject's left, y up, z out of the face. Units are mm for
.obj and .ply, and metres for .glb and .usdz, because glTF requires it and viewers rely on it.
"""

import re
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, final

import numpy as np
from jaxtyping import Float, Float64, Int, UInt8
from numpy import ndarray
from PIL import Image

from pix2face.errors import UsageError
from pix2face.files.images import encode_image, srgb_to_linear
from pix2face.files.writing import write_file
from pix2face.geometry.other_cameras import M_PER_MM
from pix2face.models.morphable_model import MorphableModel
from pix2face.photographs.usd_files import usd_module, write_face_usdz

if TYPE_CHECKING:
    import trimesh

MeshFormat = Literal["obj", "ply", "glb", "usdz"]

# What is kept of a stem that an .obj cannot name. With the checksum behind it, any file system takes the name.
READABLE_LETTERS = 40


@final
@dataclass(frozen=True, eq=False)
class FaceMesh:
    """A mesh with its colours. If a format supports both, a texture takes precedence over vertex colours.

    Attributes:
        vertices: mm, model frame.
        model: The model, with the triangles and texture coordinates of these vertices.
        vertex_colours: RGB, or None.
        texture: RGB in the model's texture coordinates, first row at v = 1, or None.
        camera: Camera of the photograph as ``gltf_camera`` describes it, for .glb and .usdz; or None.
    """

    vertices: Float[ndarray, "v 3"]
    model: MorphableModel
    vertex_colours: UInt8[ndarray, "v 3"] | None = None
    texture: UInt8[ndarray, "s s 3"] | None = None
    camera: Mapping[str, Any] | None = None


def parse_mesh_formats(text: str) -> tuple[str, ...]:
    """The formats in a list such as ``obj,glb``; none for ``none``.

    Raises:
        UsageError: One is not known, or what it needs is not installed.
    """
    if text.strip() == "none":
        return ()
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    if not set(names) <= set(_WRITERS):
        raise UsageError(f"expected --mesh to list some of {', '.join(_WRITERS)}, or none, found {text!r}")
    if "usdz" in names:
        usd_module("Usd")
    return names


def write_mesh(path: Path, mesh: FaceMesh) -> None:
    """Writes a mesh in the format of the file's suffix: .obj, .ply, .glb or .usdz.

    The k-th vertex of .obj, .ply and .usdz is the k-th of the model; .glb repeats vertices where the texture has a
    seam. A .ply has no texture: give it vertex colours. If there is a texture, a .mtl and a .png are written beside an
    .obj.

    Raises:
        UsageError: The suffix is not one of these, or USD is not installed.
    """
    writer = _WRITERS.get(path.suffix.lower().removeprefix("."))
    if writer is None:
        raise UsageError(f"{path}: expected a mesh file ending in {', '.join('.' + name for name in _WRITERS)}")
    writer(path, mesh)


def material_stem(stem: str) -> str:
    """The stem of the files beside an .obj: its own, if the format, which has no quotes, can express it.

    Readers end a name at a space, begin a comment at ``#``, and take a leading ``-`` for an option. Letters of any
    script are safe in UTF-8. Unsafe characters become ``_``, and a checksum keeps such names distinct.
    """
    safe = re.sub(r"^-|[\s#\\\x00-\x1f\x7f\ud800-\udfff]", "_", stem)
    if safe == stem:
        return stem
    return f"{safe[:READABLE_LETTERS]}-{zlib.crc32(stem.encode(errors='surrogateescape')):08x}"


@lru_cache(maxsize=2)
def split_at_seams(
    model: MorphableModel,
) -> tuple[Int[ndarray, " n"], Float64[ndarray, "n 2"], Int[ndarray, "t 3"]]:
    """Splits vertices so that each has one texture coordinate.

    Returns:
        For each new vertex, the vertex of the model and the texture coordinate; and the triangles of the new vertices.

    Raises:
        UsageError: The model has no texture coordinates.
    """
    if model.uv is None or model.uv_triangles is None:
        raise UsageError(f"expected texture coordinates in the model {model.name!r}, found none")
    pairs = np.stack([model.triangles.ravel(), model.uv_triangles.ravel()], axis=1)
    unique, triangles = np.unique(pairs, axis=0, return_inverse=True)
    split = unique[:, 0], model.uv[unique[:, 1]].astype(np.float64), triangles.reshape(-1, 3)
    for shared in split:
        shared.flags.writeable = False
    return split


def _write_obj(path: Path, mesh: FaceMesh) -> None:
    text = "# mm; x to the subject's left, y up, z out of the face\n"
    uv, uv_triangles = mesh.model.uv, mesh.model.uv_triangles
    columns, triangles = [mesh.vertices], mesh.model.triangles + 1
    if mesh.texture is not None and uv is not None and uv_triangles is not None:
        material = path.with_name(f"{material_stem(path.stem)}.mtl")
        _write_material(material, mesh.texture)
        text += f"mtllib {material.name}\nusemtl face\n"
        corners = np.stack([triangles, uv_triangles + 1], axis=2)
        faces = _lines("vt %.6f %.6f", uv) + _lines("f %d/%d %d/%d %d/%d", corners)
    else:
        if mesh.vertex_colours is not None:
            columns.append(mesh.vertex_colours / 255)
        faces = _lines("f %d %d %d", triangles)
    vertices = np.hstack(columns)
    write_file(path, text + _lines("v" + vertices.shape[1] * " %.6g", vertices) + faces)


def _lines(row: str, values: ndarray) -> str:
    """Numbers as lines of text, by the format of a line. One call is several times as fast as one a line."""
    return len(values) * f"{row}\n" % tuple(values.ravel().tolist())


def _write_material(path: Path, texture: UInt8[ndarray, "s s 3"]) -> None:
    picture = path.with_name(f"{path.stem}-texture.png")
    write_file(picture, encode_image(texture))
    write_file(path, f"newmtl face\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {picture.name}\n")


def _write_ply(path: Path, mesh: FaceMesh) -> None:
    import trimesh  # half a second, which commands that write no such mesh save

    plain = trimesh.Trimesh(mesh.vertices, mesh.model.triangles, vertex_colors=mesh.vertex_colours, process=False)
    write_file(path, _exported(plain, "ply"))


def _write_glb(path: Path, mesh: FaceMesh) -> None:
    import trimesh

    vertices = mesh.vertices * M_PER_MM
    if mesh.texture is not None:
        vertex, uv, triangles = split_at_seams(mesh.model)
        material = trimesh.visual.material.PBRMaterial(  # type: ignore[no-untyped-call]
            name="face", baseColorTexture=Image.fromarray(mesh.texture), metallicFactor=0.0, roughnessFactor=1.0
        )
        visual = trimesh.visual.TextureVisuals(uv=uv, material=material)  # type: ignore[no-untyped-call]
        shown = trimesh.Trimesh(vertices[vertex], triangles, visual=visual, process=False)
    else:
        colours = None if mesh.vertex_colours is None else linear_colours(mesh.vertex_colours)
        shown = trimesh.Trimesh(vertices, mesh.model.triangles, vertex_colors=colours, process=False)

    def add_camera(tree: dict[str, Any]) -> None:
        if mesh.camera is not None:
            tree["cameras"] = [{"name": "photograph", **mesh.camera["camera"]}]
            tree["scenes"][0]["nodes"].append(len(tree["nodes"]))
            tree["nodes"].append({"name": "photograph", "camera": 0, "matrix": mesh.camera["matrix"]})

    write_file(path, _exported(shown, "glb", tree_postprocessor=add_camera))


def _exported(mesh: "trimesh.Trimesh", kind: MeshFormat, **options: Any) -> bytes:
    content = mesh.export(file_type=kind, **options)
    assert isinstance(content, bytes)
    return content


def linear_colours(colours: UInt8[ndarray, "n 3"]) -> UInt8[ndarray, "n 3"]:
    """Converts colours of a photograph to those of vertices in glTF, which are proportional to light."""
    return np.asarray(np.rint(255 * srgb_to_linear(np.arange(256) / 255)).astype(np.uint8)[colours])


def _write_usdz(path: Path, mesh: FaceMesh) -> None:
    write_face_usdz(path, mesh.vertices, mesh.model, mesh.vertex_colours, mesh.texture, mesh.camera)


_WRITERS: dict[str, Callable[[Path, FaceMesh], None]] = {
    "obj": _write_obj,
    "ply": _write_ply,
    "glb": _write_glb,
    "usdz": _write_usdz,
}
