"""Meshes open in another reader with the right counts, in mm, in the colours that they were given."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.files.images import read_photograph
from pix2face.geometry.other_cameras import gltf_camera
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.surface_attributes import split_at_seams
from pix2face.photographs.mesh_files import (
    FaceMesh,
    linear_colours,
    material_stem,
    parse_mesh_formats,
    write_mesh,
)
from tests.pix2face.geometry.test_other_cameras import PINHOLE, SIZE_PX, WEAK, projected_by_gltf
from tests.synthetic_models import small_head_model
from tests.textured_head import textured_head

PLAIN, TEXTURED = small_head_model(), textured_head()


def face(model: MorphableModel) -> ndarray:
    rng = np.random.default_rng(1)
    return model.vertices(rng.normal(size=(1, model.n_identity)), rng.normal(size=(1, model.n_expression)))[0]


def colours(n: int) -> ndarray:
    return np.random.default_rng(2).integers(0, 256, (n, 3)).astype(np.uint8)


def load(path: Path) -> trimesh.Trimesh:
    """In mm: glTF is in metres."""
    mesh = trimesh.load(path, process=False, maintain_order=True, force="mesh")
    return mesh.apply_scale(1000) if path.suffix == ".glb" else mesh


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_the_mesh_is_that_of_the_fit_in_mm(tmp_path: Path, suffix: str) -> None:
    write_mesh(str(tmp_path / f"face{suffix}"), FaceMesh(face(PLAIN), PLAIN))
    mesh = load(tmp_path / f"face{suffix}")
    np.testing.assert_array_equal(mesh.faces, PLAIN.triangles)
    np.testing.assert_allclose(mesh.vertices, face(PLAIN), atol=1e-3)
    assert mesh.volume > 0  # wound counter-clockwise seen from outside


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_vertex_colours_come_back(tmp_path: Path, suffix: str) -> None:
    given = colours(len(PLAIN.mean))
    write_mesh(tmp_path / f"face{suffix}", FaceMesh(face(PLAIN), PLAIN, vertex_colours=given))
    mesh = load(tmp_path / f"face{suffix}")
    np.testing.assert_array_equal(mesh.faces, PLAIN.triangles)
    assert np.abs(mesh.visual.vertex_colors[:, :3].astype(int) - given).max() <= 1


def test_colours_of_glb_vertices_are_proportional_to_light(tmp_path: Path) -> None:
    given = colours(len(PLAIN.mean))
    write_mesh(tmp_path / "face.glb", FaceMesh(face(PLAIN), PLAIN, vertex_colours=given))
    found = load(tmp_path / "face.glb").visual.vertex_colors[:, :3]
    np.testing.assert_array_equal(found, linear_colours(given))
    # IEC 61966-2-1: half of full scale is 0.2140 of the light.
    np.testing.assert_array_equal(linear_colours(np.array([[0, 128, 255]], dtype=np.uint8)), [[0, 55, 255]])


@pytest.mark.parametrize("suffix", [".obj", ".glb"])
def test_the_texture_lies_where_the_model_says(tmp_path: Path, suffix: str) -> None:
    """A texture that spells out (u, v) in red and green must be met by each vertex at its own coordinates."""
    assert TEXTURED.uv is not None
    assert TEXTURED.uv_triangles is not None
    size = 256
    ramp = ((np.arange(size) + 0.5) / size * 255).astype(np.uint8)
    texture = np.zeros((size, size, 3), dtype=np.uint8)
    texture[..., 0], texture[..., 1] = ramp[None, :], ramp[::-1, None]  # u to the right, v upward
    write_mesh(tmp_path / f"face{suffix}", FaceMesh(face(TEXTURED), TEXTURED, texture=texture))
    mesh = trimesh.load(tmp_path / f"face{suffix}", process=False, force="mesh")
    mesh.apply_scale(1000 if suffix == ".glb" else 1)
    assert mesh.faces.shape == TEXTURED.triangles.shape
    np.testing.assert_allclose(mesh.triangles, face(TEXTURED)[TEXTURED.triangles], atol=1e-3)
    uv = mesh.visual.uv[mesh.faces]
    np.testing.assert_allclose(uv, TEXTURED.uv[TEXTURED.uv_triangles], atol=1e-5)
    seen = mesh.visual.to_color().vertex_colors[mesh.faces][..., :2] / 255
    assert np.abs(seen - uv).max() < 0.02


def test_seams_split_vertices_and_nothing_else() -> None:
    vertex, uv, triangles = split_at_seams(TEXTURED)
    assert TEXTURED.uv is not None
    assert TEXTURED.uv_triangles is not None
    np.testing.assert_array_equal(vertex[triangles], TEXTURED.triangles)
    np.testing.assert_array_equal(uv[triangles], TEXTURED.uv[TEXTURED.uv_triangles])
    pairs = {tuple(pair) for pair in np.stack([TEXTURED.triangles, TEXTURED.uv_triangles], axis=-1).reshape(-1, 2)}
    assert len(vertex) == len(pairs) > len(TEXTURED.mean)


def test_a_model_without_texture_coordinates_is_named() -> None:
    with pytest.raises(UsageError, match="small synthetic head"):
        split_at_seams(PLAIN)


@pytest.mark.parametrize("stem", ["portrait", "Jos\xe9", "a.b", "x-1"])
def test_the_material_keeps_a_name_that_the_format_can_hold(stem: str) -> None:
    assert material_stem(stem) == stem


@pytest.mark.parametrize("stem", ["Jos\xe9", "\u65e5\u672c\u8a9e", "\u041c\u0430\u0440\u0438\u044f", "e\u0301"])
def test_other_readers_find_the_texture_of_a_name_in_any_script(tmp_path: Path, stem: str) -> None:
    texture = np.full((8, 8, 3), 77, dtype=np.uint8)
    write_mesh(tmp_path / f"{stem}.obj", FaceMesh(face(TEXTURED), TEXTURED, texture=texture))
    assert {path.name for path in tmp_path.iterdir()} == {f"{stem}.obj", f"{stem}.mtl", f"{stem}-texture.png"}
    read = trimesh.load(tmp_path / f"{stem}.obj", force="mesh")
    np.testing.assert_array_equal(np.asarray(read.visual.material.image), texture)


UNSAFE = {
    "my photo": "my_photo",
    "a#b": "a_b",
    "-x": "_x",
    "tab\tline\n": "tab_line_",
    "caf\udce9": "caf_",
    "a\\b": "a_b",
    "\x1b[31m": "_[31m",
    "a long name " * 20: "a_long_name_a_long_name_a_long_name_a_lo",
}


@pytest.mark.parametrize(("stem", "readable"), UNSAFE.items())
def test_other_names_get_a_material_of_their_own(tmp_path: Path, stem: str, readable: str) -> None:
    assert re.fullmatch(rf"{re.escape(readable)}-[0-9a-f]{{8}}", material_stem(stem))
    assert material_stem(stem) != material_stem(stem + "x")
    texture = np.full((8, 8, 3), 77, dtype=np.uint8)
    write_mesh(tmp_path / f"{stem}.obj", FaceMesh(face(TEXTURED), TEXTURED, texture=texture))
    (material,) = tmp_path.glob("*.mtl")
    picture = re.search("^map_Kd (.*)$", material.read_text(), re.MULTILINE)
    assert picture is not None
    np.testing.assert_array_equal(read_photograph(tmp_path / picture[1]), texture)
    assert f"mtllib {material.name}\n" in (tmp_path / f"{stem}.obj").read_text()


def test_formats_are_read_from_a_list() -> None:
    assert parse_mesh_formats("glb, obj,glb") == ("glb", "obj")
    assert parse_mesh_formats("none") == ()
    for text in ("stl", "obj,", ""):
        with pytest.raises(UsageError, match="expected --mesh to list some of obj, ply, glb"):
            parse_mesh_formats(text)


def test_another_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"face\.stl: expected a mesh file"):
        write_mesh(tmp_path / "face.stl", FaceMesh(face(PLAIN), PLAIN))


@pytest.mark.parametrize("kind", ["weak-perspective", "pinhole"])
def test_a_glb_brings_the_camera_of_its_photograph(kind: str, tmp_path: Path) -> None:
    """pygltflib reads the file; its camera and its mesh, by glTF's own formulas, give the pixels of the fit."""
    pygltflib = pytest.importorskip("pygltflib", reason="pip install 'pix2face[dev]'")
    camera = {"weak-perspective": WEAK, "pinhole": PINHOLE}[kind]
    write_mesh(tmp_path / "face.glb", FaceMesh(face(PLAIN), PLAIN, camera=gltf_camera(camera, SIZE_PX)))
    stored = pygltflib.GLTF2().load(str(tmp_path / "face.glb"))
    (node,) = (own for index, own in enumerate(stored.nodes) if index in stored.scenes[0].nodes and own.camera == 0)
    form = {"camera": json.loads(stored.cameras[0].to_json()), "matrix": node.matrix}
    position = stored.accessors[stored.meshes[0].primitives[0].attributes.POSITION]
    view = stored.bufferViews[position.bufferView]
    content = stored.binary_blob()[view.byteOffset + (position.byteOffset or 0) :]
    vertices = np.frombuffer(content, "<f4", 3 * position.count).reshape(-1, 3)
    np.testing.assert_allclose(projected_by_gltf(form, vertices), camera.project(face(PLAIN)), atol=1e-3)


def test_trimesh_sees_the_face_through_the_camera_of_a_glb(tmp_path: Path) -> None:
    write_mesh(tmp_path / "face.glb", FaceMesh(face(PLAIN), PLAIN, camera=gltf_camera(PINHOLE, SIZE_PX)))
    scene = trimesh.load_scene(tmp_path / "face.glb")
    scene.camera.resolution = SIZE_PX[::-1]
    vertices = scene.to_mesh().vertices
    x, y, z = trimesh.transform_points(vertices, np.linalg.inv(scene.camera_transform)).T
    focal = scene.camera.focal[1]  # of the horizontal angle it makes yfov times aspectRatio, which glTF does not mean
    pixels = np.column_stack([SIZE_PX[1] / 2 + focal * x / -z, SIZE_PX[0] / 2 - focal * y / -z])
    np.testing.assert_allclose(pixels, PINHOLE.project(face(PLAIN)), atol=1e-3)
