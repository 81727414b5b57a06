"""Other people behind the one whose face a picture is about."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datagen.appearance.appearance import Appearance, appearance_textures, draw_appearance
from datagen.appearance.appearance_config import DEFAULT, HARD, PRESETS
from datagen.appearance.backdrop.backdrop import PersonPlace, draw_backdrop
from datagen.appearance.light.light_sources import Light, seen_light
from datagen.appearance.light.shading import head_occlusion
from datagen.appearance.scene import Scene, ScenePicture
from datagen.appearance.scene_making import SceneMaker
from datagen.appearance.skin.zones import head_paint
from datagen.opengl.gl_context import GLContext
from datagen.rendering.scenes.scene_drawing import SceneDrawer
from datagen.samples.bystanders import DRAWN_PX, N_PEOPLE, UNSEEN, Bystanders, _placed, plainer
from datagen.sampling.faces import sample_faces
from pix2face.geometry.camera import Camera
from pix2face.models.morphable_model import builtin_model

SIZE, SEED = 144, 3
MIDDLE = PersonPlace(x=0.5, y=0.5, scale=0.4, blur=0.006, seed=7)


@pytest.fixture(scope="module")
def scenes() -> SceneMaker:
    return SceneMaker(builtin_model())


@pytest.fixture(scope="module")
def drawer(gl_session: GLContext) -> SceneDrawer:
    model = builtin_model()
    return SceneDrawer(model, gl_session, appearance_textures(), head_paint(model), head_occlusion(model))


@pytest.fixture(scope="module")
def bystanders(scenes: SceneMaker, drawer: SceneDrawer) -> Bystanders:
    return Bystanders(scenes, drawer, SEED, PRESETS[DEFAULT])


def with_people(*places: PersonPlace) -> Appearance:
    appearance = draw_appearance(SEED, "front", PRESETS[DEFAULT])
    backdrop = replace(appearance.backdrop, people=places, n_people=len(places))
    return replace(appearance, backdrop=backdrop)


def drawn(bystanders: Bystanders, *places: PersonPlace, level: float = 0.0, light: Light | None = None) -> np.ndarray:
    backdrop = np.full((SIZE, SIZE, 3), level, np.float32)
    front = with_people(*places)
    bystanders.draw(backdrop, front if light is None else replace(front, light=light))
    return backdrop


@pytest.mark.gl
def test_nobody_changes_nothing(bystanders: Bystanders) -> None:
    assert (drawn(bystanders, level=0.25) == 0.25).all()


@pytest.mark.gl
def test_somebody_stands_at_the_place_and_covers_what_is_behind(bystanders: Bystanders) -> None:
    dark, light = drawn(bystanders, MIDDLE), drawn(bystanders, MIDDLE, level=1.0)
    assert np.isfinite(dark).all()
    assert dark.min() >= -1e-5
    hidden = 1 - (light - dark)[..., 0]  # how much of what is behind somebody takes
    rows, columns = np.nonzero(hidden > 0.5)
    assert hidden.max() > 0.98
    assert abs(columns.mean() / SIZE - MIDDLE.x) < 0.1
    assert rows.min() / SIZE < MIDDLE.y < rows.max() / SIZE
    assert np.abs(hidden[:, :10]).max() < 1e-3
    assert dark[hidden > 0.9].mean() > 0.005


@pytest.mark.gl
def test_who_is_farther_is_smaller_and_a_share_of_the_picture(bystanders: Bystanders) -> None:
    areas = []
    for scale in (0.2, 0.4, 0.6):
        place = replace(MIDDLE, scale=scale)
        hidden = 1 - (drawn(bystanders, place, level=1.0) - drawn(bystanders, place))[..., 0]
        areas.append(hidden.sum())
    assert areas[0] < areas[1] < areas[2]
    assert areas[1] / areas[0] == pytest.approx(4, rel=0.15)


@pytest.mark.gl
def test_the_seed_of_a_place_decides_who_it_is(bystanders: Bystanders) -> None:
    first = drawn(bystanders, MIDDLE)
    np.testing.assert_array_equal(drawn(bystanders, MIDDLE), first)
    assert np.abs(drawn(bystanders, replace(MIDDLE, seed=8)) - first).max() > 0.01
    np.testing.assert_array_equal(drawn(bystanders, replace(MIDDLE, seed=MIDDLE.seed + N_PEOPLE)), first)


@pytest.mark.gl
def test_other_seeds_of_a_job_have_other_people(
    bystanders: Bystanders, scenes: SceneMaker, drawer: SceneDrawer
) -> None:
    others = Bystanders(scenes, drawer, SEED + 1, PRESETS[DEFAULT])
    assert np.abs(drawn(others, MIDDLE) - drawn(bystanders, MIDDLE)).max() > 0.01


@pytest.mark.gl
def test_they_are_of_the_brightness_and_colour_of_the_light(bystanders: Bystanders) -> None:
    light = draw_appearance(SEED, "front", PRESETS[DEFAULT]).light
    white = replace(light, lamps=(), ambient=(1.0, 1.0, 1.0) + 24 * (0.0,))
    red = replace(white, ambient=(0.5, 0.1, 0.1) + 24 * (0.0,))
    np.testing.assert_allclose(seen_light(white), 1, rtol=1e-6)
    in_white = drawn(bystanders, MIDDLE, light=white)
    assert 0.02 < in_white.max() < 1.2  # skin, hair and clothes: no surface is brighter than what falls on it
    np.testing.assert_allclose(drawn(bystanders, MIDDLE, light=red), in_white * [0.5, 0.1, 0.1], atol=1e-6)


@pytest.mark.gl
def test_each_is_drawn_once(bystanders: Bystanders, drawer: SceneDrawer, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[tuple[int, int]] = []
    original = drawer.draw

    def noted(scene: Scene, camera: Camera, height: int, width: int) -> ScenePicture:
        sizes.append((height, width))
        return original(scene, camera, height, width)

    monkeypatch.setattr(drawer, "draw", noted)
    near, far = replace(MIDDLE, scale=0.6, blur=0.0, seed=50), replace(MIDDLE, scale=0.18, blur=0.02, seed=51)
    drawn(bystanders, near, far)
    drawn(bystanders, far, near, near)
    assert sizes == [(DRAWN_PX, DRAWN_PX)] * 2


def test_far_people_have_no_shadows_and_nothing_too_small_to_be_seen(scenes: SceneMaker) -> None:
    model, config = builtin_model(), PRESETS[HARD]
    table = sample_faces(model, 8, 0, 96, config.geometry)
    vertices = model.vertices(table.identity, table.expression)
    left_out = set()
    for index in range(8):
        face = table.face(index, Path())
        whole = scenes.scene(draw_appearance(SEED, str(index), config), face, vertices[index])
        found = plainer(whole)
        assert not found.lights.size
        assert found.head is whole.head
        kept = {mesh.name for mesh in found.meshes}
        assert not any(name.startswith(UNSEEN) for name in kept)
        left_out |= {mesh.name.split("/")[0] for mesh in whole.meshes if mesh.name not in kept}
    assert left_out == {name.rstrip("/") for name in UNSEEN}


def test_six_pictures_of_a_hundred_have_somebody_behind() -> None:
    config, light = PRESETS[DEFAULT].backdrop, draw_appearance(SEED, "front", PRESETS[DEFAULT]).light
    rng, n = np.random.default_rng(SEED), 3000
    shown = sum(draw_backdrop(rng, config, light).n_people > 0 for _ in range(n))
    assert config.people_share == 0.06
    assert shown / n == pytest.approx(0.06, abs=0.015)


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_the_middle_of_a_person_lies_at_its_place_to_the_half_pixel(scale: float) -> None:
    rgba = np.ones((10, 10, 4), np.float32)
    place = PersonPlace(x=0.3, y=0.6, scale=0.3, blur=0.0, seed=0)
    placed = _placed(rgba, place, scale, (100, 200))[..., 3]
    rows, columns = np.indices(placed.shape) + 0.5
    assert (placed * columns).sum() / placed.sum() == pytest.approx(0.3 * 200, abs=0.05)
    assert (placed * rows).sum() / placed.sum() == pytest.approx(0.6 * 100, abs=0.05)
