"""Shadows fall on the side away from the light, where something stands before it, and nowhere else."""

import numpy as np
import pytest
from numpy import ndarray
from scipy.spatial import KDTree

from datagen.appearance.scene import SceneMesh
from datagen.opengl.gl_context import GLContext
from datagen.rendering.scenes.scene_head import coarse_triangles, split_by_uv
from datagen.rendering.scenes.scene_shadows import SHADOW_FROM_CLIP, light_view
from pix2face.models.morphable_model import builtin_model
from tests.datagen.rendering.plain_scenes import LAMBERT, SHADOWS, ball, camera_at, plain_drawer, scene_of, sheet
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.gl

SIZE = 128


def lit(gl: GLContext, model, lights: list, meshes=(), camera=None, vertices: ndarray | None = None) -> ndarray:
    """What arrives of the first light and of the sky, cosine to the first light, coverage; at each pixel."""
    with plain_drawer(model, gl, SHADOWS) as drawer:
        scene = scene_of(model, meshes, lights, vertices)
        picture = drawer.draw(scene, camera or camera_at(0, 0, SIZE), SIZE, SIZE)
    return np.concatenate([picture.radiance, picture.coverage[..., None]], axis=2)


@pytest.mark.parametrize("make_model", [builtin_model, small_head_model])
@pytest.mark.parametrize("light", [(0, 0, 1), (0.7, 0.2, 0.7), (-0.6, 0.6, 0.5), (0.2, -0.4, 0.9)])
def test_what_faces_a_light_is_not_in_its_own_shadow(gl: GLContext, make_model, light: tuple) -> None:
    found = lit(gl, make_model(), [light])
    facing = (found[..., 3] > 0.999) & (found[..., 2] > 0.8)
    assert facing.sum() > 500
    assert (found[..., 0][facing] > 0.9).mean() > 0.97
    assert (found[..., 0][facing] > 0.5).mean() > 0.99


def test_a_light_from_the_side_leaves_the_other_side_dark(gl: GLContext) -> None:
    model = builtin_model()
    with plain_drawer(model, gl, LAMBERT) as drawer:
        for side in (-1, 1):
            picture = drawer.draw(scene_of(model, [], [[side, 0.1, 0.3]]), camera_at(0, 0, SIZE), SIZE, SIZE)
            halves = [
                picture.radiance[:, part][picture.coverage[:, part] > 0.99].mean() for part in (np.s_[:64], np.s_[64:])
            ]
            bright, dark = halves[::-1] if side > 0 else halves  # the subject's left is at the image's right
            assert dark < 0.5 * bright


def test_the_nose_casts_a_shadow_on_the_cheek(gl: GLContext) -> None:
    """Beside the nose the surface faces the light and is dark all the same, on the far side alone."""
    model = builtin_model()
    found = lit(gl, model, [(0.75, 0.3, 0.6)])
    shaded = (found[..., 3] > 0.999) & (found[..., 2] > 0.25) & (found[..., 0] < 0.2)
    rows, columns = np.nonzero(shaded[50:90])
    assert len(rows) > 15
    assert np.median(columns) < SIZE / 2


def test_something_before_the_light_throws_its_shadow_where_the_ray_arrives(gl: GLContext) -> None:
    model = small_head_model()
    light = np.array([0.5, 0.5, 0.7]) / np.linalg.norm([0.5, 0.5, 0.7])
    target = np.array([-30.0, 40, 70])
    blocker = [ball(target + 150 * light, 20)]
    camera = camera_at(0, 0, SIZE)
    without, behind = lit(gl, model, [light]), lit(gl, model, [light], blocker)
    darker = (without[..., 0] - behind[..., 0] > 0.5) & (behind[..., 3] > 0.99)
    darker &= np.abs(behind[..., 1] - without[..., 1]) < 0.5
    rows, columns = np.nonzero(darker)
    assert len(rows) > 50
    surface = target  # near enough: the head's surface along that ray
    centre = camera.project(np.array([surface]))[0]
    assert np.hypot(columns.mean() + 0.5 - centre[0], rows.mean() + 0.5 - centre[1]) < 8
    ghost = [ball(target + 150 * light, 20, casts_shadow=False)]
    np.testing.assert_allclose(lit(gl, model, [light], ghost)[64:][..., 0], without[64:][..., 0], atol=1e-3)


def test_transparent_parts_cast_no_shadow(gl: GLContext) -> None:
    model = small_head_model()

    def beside(alpha: float) -> ndarray:
        """A sheet at the subject's left, out of the picture, between head and light."""
        mesh = sheet(120, alpha=alpha, kind="hair")
        turned = SceneMesh(**{**vars(mesh), "vertices": np.ascontiguousarray(mesh.vertices[:, ::-1])})
        return lit(gl, model, [(1, 0, 0.1)], [turned])

    clear, dark = beside(0.3), beside(0.8)
    facing = (clear[..., 3] > 0.999) & (clear[..., 2] > 0.4)
    facing &= dark[..., 2] == clear[..., 2]  # the head, not the sheet
    assert facing.sum() > 200
    assert clear[facing][:, 0].mean() > 0.95
    assert dark[facing][:, 0].mean() < 0.05


def test_the_sky_is_shut_under_a_roof(gl: GLContext) -> None:
    model = small_head_model()
    roof = ball((0, 170, 110), 60)
    lights = [(0, 0, 1), (1, 0, 0), (0, 1, 0.3)]
    open_sky, shut = (lit(gl, model, lights, meshes, camera_at(0, 0, SIZE)) for meshes in ([], [roof]))
    forehead = np.s_[40:60, 60:68]
    assert open_sky[forehead][..., 1].mean() > 0.9
    assert shut[forehead][..., 1].mean() < 0.2


def test_without_lights_everything_is_lit(gl: GLContext) -> None:
    found = lit(gl, small_head_model(), [])
    covered = found[..., 3] > 0.999
    np.testing.assert_allclose(found[covered][:, :2], 1, atol=1e-3)


def test_a_view_along_a_light_holds_the_sphere_and_what_is_before_it() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        centre = rng.normal(size=3) * 20
        shadow_from_model = SHADOW_FROM_CLIP @ light_view(direction, centre, 150.0)
        sphere = rng.normal(size=(200, 3))
        sphere = centre + 150 * sphere / np.linalg.norm(sphere, axis=1, keepdims=True)
        place = sphere @ shadow_from_model[:3, :3].T + shadow_from_model[:3, 3]
        assert place.min() > -1e-9
        assert place.max() < 1 + 1e-9
        nearer = (sphere + 40 * direction) @ shadow_from_model[:3, :3].T + shadow_from_model[:3, 3]
        np.testing.assert_allclose(nearer[:, :2], place[:, :2], atol=1e-9)
        assert (nearer[:, 2] < place[:, 2]).all()


def test_the_coarse_head_follows_the_surface_with_a_third_of_the_triangles() -> None:
    model = builtin_model()
    source, uv, triangles = split_by_uv(model)
    assert len(uv) == len(source)
    np.testing.assert_array_equal(source[triangles], model.triangles)
    coarse = coarse_triangles(model)
    assert len(coarse) < len(triangles) / 3
    centres = model.mean[coarse].mean(axis=1)
    assert np.quantile(KDTree(model.mean).query(centres)[0], 0.99) < 6
