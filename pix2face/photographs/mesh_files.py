"""Fitted meshes as ``.obj``, ``.ply``, ``.glb`` and ``.usdz``, with colours per vertex or a texture.

Layouts: docs/reference. All are in the model frame: x to the subject's left, y up, z out of the face. Units are mm for
.obj and .ply, and metres for .glb and .usdz, because glTF requires it and viewers rely on it.
"""

import re
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, final

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.files.images import encode_image, srgb_to_linear
from pix2face.files.meshes.glb import GlbContent
from pix2face.files.meshes.ply import encode_ply
from pix2face.files.writing import write_file
from pix2face.geometry.other_cameras import M_PER_MM
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.surface_attributes import split_at_seams
from pix2face.photographs.usd_files import usd_module, write_face_usdz

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

    @cached_property
    def texture_file(self) -> bytes | None:
        """The texture as PNG, or None. It is encoded on first access, since that takes as long as the rest."""
        return None if self.texture is None else encode_image(self.texture)


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


def write_mesh(path: Path | str, mesh: FaceMesh) -> None:
    """Writes a mesh in the format of the file's suffix: .obj, .ply, .glb or .usdz.

    The k-th vertex of .obj, .ply and .usdz is the k-th of the model; .glb repeats vertices where the texture has a
    seam. A .ply has no texture: give it vertex colours. If there is a texture, a .mtl and a .png are written beside an
    .obj.

    Raises:
        UsageError: The suffix is not one of these, or USD is not installed.
    """
    path = Path(path)
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


def _write_obj(path: Path, mesh: FaceMesh) -> None:
    text = "# mm; x to the subject's left, y up, z out of the face\n"
    uv, uv_triangles = mesh.model.uv, mesh.model.uv_triangles
    columns, triangles = [mesh.vertices], mesh.model.triangles + 1
    if mesh.texture_file is not None and uv is not None and uv_triangles is not None:
        material = path.with_name(f"{material_stem(path.stem)}.mtl")
        _write_material(material, mesh.texture_file)
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


def _write_material(path: Path, texture_file: bytes) -> None:
    picture = path.with_name(f"{path.stem}-texture.png")
    write_file(picture, texture_file)
    write_file(path, f"newmtl face\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {picture.name}\n")


def _write_ply(path: Path, mesh: FaceMesh) -> None:
    write_file(path, encode_ply(mesh.vertices, mesh.vertex_colours, mesh.model.triangles))


def _write_glb(path: Path, mesh: FaceMesh) -> None:
    content, vertices, triangles = GlbContent(), mesh.vertices * M_PER_MM, mesh.model.triangles
    nodes: list[dict[str, Any]] = [{"name": "geometry_0", "mesh": 0}]
    tree: dict[str, Any] = {"asset": {"version": "2.0", "generator": "pix2face"}, "scene": 0, "nodes": nodes}
    attributes, material = {}, {}
    if mesh.texture_file is not None:
        vertex, uv, triangles = split_at_seams(mesh.model)
        vertices = vertices[vertex]
        attributes["TEXCOORD_0"] = content.add(np.column_stack([uv[:, 0], 1 - uv[:, 1]]), "VEC2")
        tree["images"] = [{"bufferView": content.add_bytes(mesh.texture_file), "mimeType": "image/png"}]
        tree["textures"] = [{"source": 0}]
        surface = {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0}
        tree["materials"] = [{"name": "face", "pbrMetallicRoughness": surface}]
        material = {"material": 0}
    elif mesh.vertex_colours is not None:
        opaque = np.full((len(vertices), 1), 255, dtype=np.uint8)
        attributes["COLOR_0"] = content.add(np.hstack([linear_colours(mesh.vertex_colours), opaque]), "VEC4")
    attributes["POSITION"] = content.add(vertices, "VEC3")
    primitive = {"attributes": attributes, "indices": content.add(triangles, "SCALAR"), **material}
    tree["meshes"] = [{"name": "geometry_0", "primitives": [primitive]}]
    if mesh.camera is not None:
        tree["cameras"] = [{"name": "photograph", **mesh.camera["camera"]}]
        nodes.append({"name": "photograph", "camera": 0, "matrix": mesh.camera["matrix"]})
    tree["scenes"] = [{"nodes": list(range(len(nodes)))}]
    write_file(path, content.file(tree))


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
