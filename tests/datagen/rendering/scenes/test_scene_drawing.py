"""What hides what, what shines through what, and what the driver is left with."""

import gc
import itertools
import weakref
from contextlib import ExitStack
from dataclasses import replace
from typing import Any
from unittest import mock

import moderngl
import numpy as np
import pytest

from datagen.appearance.scene import SCENE_LABELS, Material, Scene, SceneMesh, Texture
from datagen.opengl.gl_context import GLContext
from datagen.rendering.renderer import Renderer
from datagen.rendering.scenes.scene_drawing import SceneDrawer
from pix2face.errors import UsageError
from pix2face.models.morphable_model import builtin_model
from tests.datagen.rendering.plain_scenes import ball, camera_at, head_of, plain_drawer, scene_of, sheet
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.gl

SIZE = 64
RED, GREEN, BLUE = np.eye(3)


def label(name: str) -> int:
    return SCENE_LABELS.index(name)


def test_a_mesh_in_front_hides_the_head_and_one_behind_does_not(gl: GLContext) -> None:
    model = small_head_model()
    meshes = [ball((0, 0, 160), 30, colour=(1, 0, 0)), ball((0, 20, -160), 30, label="hair", colour=(0, 1, 0))]
    with plain_drawer(model, gl) as drawer:
        picture = drawer.draw(scene_of(model, meshes), camera_at(0, 0, SIZE), SIZE, SIZE)
    middle = SIZE // 2
    assert picture.labels[middle, middle] == label("occluder")
    np.testing.assert_allclose(picture.radiance[middle, middle], RED, atol=1e-3)
    assert (picture.labels == label("occluder")).sum() == pytest.approx(np.pi * (30 * 0.0038 * SIZE) ** 2, rel=0.05)
    assert label("hair") not in picture.labels
    assert picture.labels[middle - 20, middle] == label("head")


def test_the_edge_between_two_surfaces_mixes_their_colours_alone(gl: GLContext) -> None:
    model = small_head_model()
    with plain_drawer(model, gl) as drawer:
        picture = drawer.draw(
            scene_of(model, [ball((0, 0, 160), 40, colour=(1, 0, 0))]), camera_at(0, 0, SIZE), SIZE, SIZE
        )
    window = np.s_[16:48, 20:44]
    red, green = picture.radiance[window][..., 0], picture.radiance[window][..., 1]
    np.testing.assert_allclose(picture.coverage[window], 1, atol=1e-3)
    np.testing.assert_allclose(red, 1 - green, atol=2e-3)  # (0.5, 0.5, 0.5) to (1, 0, 0): on the line between
    mixed = (green > 0.05) & (green < 0.45)
    assert 20 < mixed.sum() < 200


@pytest.mark.parametrize("distance_mm", [None, 500])
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_transparent_meshes_mix_from_far_to_near_in_whatever_order_they_come(
    gl: GLContext, order: tuple[int, ...], distance_mm: float | None
) -> None:
    model = small_head_model()
    meshes = [
        sheet(170, colour=(1, 0, 0), alpha=0.6, label="glasses"),
        sheet(150, colour=(0, 1, 0), alpha=0.3, label="mask"),
        sheet(-200, colour=(0, 0, 1), alpha=0.7, label="hair", kind="hair"),
    ]
    with plain_drawer(model, gl) as drawer:
        scene = scene_of(model, [meshes[place] for place in order])
        picture = drawer.draw(scene, camera_at(0, 0, SIZE, distance_mm), SIZE, SIZE)
    middle, corner = SIZE // 2, 15
    over_head = 0.6 * RED + 0.4 * (0.3 * GREEN + 0.7 * np.full(3, 0.5))
    np.testing.assert_allclose(picture.radiance[middle, middle], over_head, atol=2e-3)
    beside = 0.6 * RED + 0.4 * (0.3 * GREEN + 0.7 * 0.7 * BLUE)
    np.testing.assert_allclose(picture.radiance[corner, corner], beside, atol=2e-3)
    assert picture.coverage[corner, corner] == pytest.approx(1 - 0.4 * 0.7 * 0.3, abs=2e-3)
    assert set(np.unique(picture.labels[10:54, 10:54])) == {label("glasses")}


def test_a_label_is_the_nearest_of_what_is_more_opaque_than_not(gl: GLContext) -> None:
    model = small_head_model()
    meshes = [sheet(170, alpha=0.4), sheet(160, alpha=0.4), sheet(-200, alpha=0.6, label="hair")]
    with plain_drawer(model, gl) as drawer:
        picture = drawer.draw(scene_of(model, meshes), camera_at(0, 0, SIZE), SIZE, SIZE)
    assert picture.labels[SIZE // 2, SIZE // 2] == label("head")
    assert picture.labels[12, 12] == label("hair")


def test_what_is_behind_the_face_does_not_shine_through_its_edge(gl: GLContext) -> None:
    """At the silhouette a pixel shows face and hair behind: nothing of the background."""
    model = builtin_model()
    with plain_drawer(model, gl) as drawer:
        scene = scene_of(model, [sheet(-150, (-400, 400, -400, 400), alpha=1.0, kind="hair", colour=(1, 0, 0))])
        picture = drawer.draw(scene, camera_at(0, 0, SIZE), SIZE, SIZE)
    np.testing.assert_allclose(picture.coverage, 1, atol=2e-3)
    np.testing.assert_allclose(picture.radiance[..., 0], 1 - picture.radiance[..., 1], atol=3e-3)
    mixed = (picture.radiance[..., 1] > 0.05) & (picture.radiance[..., 1] < 0.45)
    assert mixed.sum() > 50


def test_textures_give_alpha(gl: GLContext) -> None:
    pixels = np.zeros((2, 8, 8, 4), dtype=np.uint8)
    pixels[1, :, 4:, 3] = 255  # the right half of the second
    mesh = sheet(160, (-100, 100, -100, 100), "hair", kind="hair", texture="hair_cards", layer=1, colour=(1, 0, 0))
    model = small_head_model()
    with plain_drawer(model, gl, textures={"hair_cards": Texture(pixels=pixels, mipmaps=False)}) as drawer:
        picture = drawer.draw(scene_of(model, [mesh]), camera_at(0, 0, SIZE), SIZE, SIZE)
    middle = SIZE // 2
    assert picture.labels[middle, middle - 10] == label("head")
    assert picture.labels[middle, middle + 10] == label("hair")


def test_meshes_that_reach_behind_a_near_camera_are_clipped(gl: GLContext) -> None:
    model = small_head_model()
    long = sheet(0, (40, 60, -20, 20), "occluder", kind="object", is_blended=False, colour=(1, 0, 0))
    vertices = long.vertices.copy()
    vertices[:, 2] = [120, 120, 900, 900]  # the camera stands at z = 300
    mesh = SceneMesh(**{**vars(long), "vertices": vertices})
    with plain_drawer(model, gl) as drawer:
        picture = drawer.draw(scene_of(model, [mesh]), camera_at(0, 0, SIZE, 300), SIZE, SIZE)
    assert np.isfinite(picture.radiance).all()
    seen = picture.labels == label("occluder")
    assert seen.any()
    assert not seen[:, : SIZE // 2].any()


def test_sizes_change_and_nothing_is_left_of_another_picture(gl: GLContext) -> None:
    model = small_head_model()
    scenes = [scene_of(model), scene_of(model, [ball((0, 0, 160), 30), sheet(180, alpha=0.5)], [[0, 0, 1]])]
    with plain_drawer(model, gl) as drawer:
        first = [drawer.draw(scene, camera_at(0, 0, SIZE), SIZE, SIZE) for scene in scenes]
        for size in range(20, 60, 4):  # more sizes than are kept
            assert drawer.draw(scenes[0], camera_at(0, 0, size), size, size + 3).labels.shape == (size, size + 3)
        again = [drawer.draw(scene, camera_at(0, 0, SIZE), SIZE, SIZE) for scene in reversed(scenes)][::-1]
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.radiance, other.radiance)
        np.testing.assert_array_equal(one.coverage, other.coverage)
        np.testing.assert_array_equal(one.labels, other.labels)


def test_a_drawer_that_nobody_keeps_gives_everything_back(gl: GLContext) -> None:
    made: list[weakref.ref[Any]] = []
    kinds = ("buffer", "texture", "texture_array", "depth_texture", "renderbuffer", "depth_renderbuffer")
    kinds += ("framebuffer", "vertex_array", "program")
    model = small_head_model()
    scene = scene_of(model, [ball((0, 0, 160), 30), sheet(180, alpha=0.5)], [[0, 0, 1]])
    textures = {"hair_cards": Texture(pixels=np.zeros((1, 2, 2, 4), dtype=np.uint8))}

    def recorded(name: str) -> Any:
        make = getattr(moderngl.Context, name)

        def wrapper(*arguments: Any, **options: Any) -> Any:
            found = make(*arguments, **options)
            made.append(weakref.ref(found))
            return found

        return mock.patch.object(moderngl.Context, name, wrapper)

    with ExitStack() as patches:
        for name in kinds:
            patches.enter_context(recorded(name))
        with plain_drawer(model, gl, textures=textures) as drawer:
            drawer.draw(scene, camera_at(0, 0, SIZE), SIZE, SIZE)
            drawer.draw(scene, camera_at(0, 0, SIZE), SIZE, SIZE + 1)
            assert len({type(each()) for each in made if each() is not None}) == 7
    del drawer
    # Whoever draws next finds a context that draws, and has bound another framebuffer.
    compute = Renderer(model, SIZE, SIZE, replace(gl, rasteriser="compute"))
    assert np.isfinite(compute.render(model.mean, camera_at(0, 0, SIZE))["depth"]).any()
    gc.collect()
    assert [each() for each in made if each() is not None] == []
    assert gl.context.objects  # they wait for their context to be current
    gl.make_current()
    assert not gl.context.objects


@pytest.mark.parametrize("is_blended", [False, True])
def test_a_mesh_of_which_nothing_is_left_changes_nothing(gl: GLContext, is_blended: bool) -> None:
    model = small_head_model()
    material = Material(kind="hair", is_blended=is_blended)
    bare = SceneMesh(**{**vars(ball((0, 0, 160), 30)), "triangles": np.zeros((0, 3), np.int32), "material": material})
    camera = camera_at(0, 0, SIZE)
    with plain_drawer(model, gl) as drawer:
        expected = drawer.draw(scene_of(model), camera, SIZE, SIZE)
        for meshes in ([bare], [bare, bare]):
            found = drawer.draw(scene_of(model, meshes), camera, SIZE, SIZE)
            np.testing.assert_array_equal(found.radiance, expected.radiance)


def test_wrong_sizes_are_refused_by_name(gl: GLContext) -> None:
    model = small_head_model()
    n = len(model.mean)
    with pytest.raises(UsageError, match=f"paint and occlusion of {n:,} vertices, found 7 and 7"):
        SceneDrawer(model, gl, {}, np.zeros((7, 8), dtype=np.float32), np.ones(7, dtype=np.float32))
    wrong = {"skin_textures": Texture(pixels=np.zeros((1, 4, 4, 3), dtype=np.float64))}
    with pytest.raises(UsageError, match=r"texture skin_textures: expected UInt8 or Float16 .* found float64"):
        SceneDrawer(model, gl, wrong, np.zeros((n, 8), dtype=np.float32), np.ones(n, dtype=np.float32))
    mesh = ball((0, 0, 160), 30)
    far = SceneMesh(**{**vars(mesh), "triangles": mesh.triangles + np.int32(5)})
    camera = camera_at(0, 0, SIZE)
    with plain_drawer(model, gl) as drawer:
        with pytest.raises(UsageError, match="mesh test/occluder: expected triangles over 642 vertices"):
            drawer.draw(scene_of(model, [far]), camera, SIZE, SIZE)
        bad = Scene(
            head=head_of(model), meshes=[], uniforms={"half_size": (1.0, 2.0, 3.0)}, lights=np.zeros((0, 3), "f4")
        )
        with pytest.raises(UsageError, match=r"half_size: expected 2 numbers, as the shader says, found \(3,\)"):
            drawer.draw(bad, camera, SIZE, SIZE)
        drawer.draw(scene_of(model), camera, SIZE, SIZE)
