"""Light that is drawn: reproducible, as bright as stated, from where the kind says, turned with the camera."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from datagen.appearance.light.environments import (
    environment_names,
    light_panorama,
)
from datagen.appearance.light.harmonics import (
    fibonacci_sphere,
    white_surface,
)
from datagen.appearance.light.light import draw_light
from datagen.appearance.light.light_colour import LUMINANCE
from datagen.appearance.light.light_config import HARD_LIGHT, LightConfig
from datagen.appearance.light.light_sources import (
    Light,
    angles_of,
    direction_of,
    seen_illuminance,
)
from datagen.appearance.light.setups import GENTLE_SETUPS, HARSH_SETUPS, Colours, build_setup
from datagen.appearance.light.shading import light_textures, light_uniforms, shadow_lights
from pix2face.errors import UsageError
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera

KINDS = ("soft", "directional", "studio", "backlit", "silhouette", "night")


def drawn(seed: int, config: LightConfig | None = None) -> Light:
    return draw_light(np.random.default_rng(seed), config or LightConfig())


def only(kind: str, **others: object) -> LightConfig:
    return replace(LightConfig(), **{f"{each}_weight": float(each == kind) for each in KINDS}, **others)


def camera(yaw: float = 0, pitch: float = 0, roll: float = 0):
    rotation = rotation_of_pose(HeadPose(pitch, yaw, roll))
    return weak_perspective_camera(WeakPerspective(1.0, rotation, np.zeros(2)))


@settings(max_examples=30)
@given(st.floats(-170, 170), st.floats(-80, 80))
def test_angles_and_directions_are_inverse(azimuth: float, elevation: float) -> None:
    found = angles_of(direction_of(azimuth, elevation))
    np.testing.assert_allclose(found, [azimuth, elevation], atol=1e-6)


def test_azimuth_is_of_the_picture() -> None:
    np.testing.assert_allclose(direction_of(0, 0), [0, 0, -1], atol=1e-12)  # from the camera
    np.testing.assert_allclose(direction_of(90, 0), [1, 0, 0], atol=1e-12)  # from the picture's right
    np.testing.assert_allclose(direction_of(0, 90), [0, -1, 0], atol=1e-12)  # from above


def test_kinds_come_as_often_as_they_weigh() -> None:
    count = Counter(drawn(seed).kind for seed in range(600))
    assert set(count) == set(KINDS)
    assert 0.48 < count["soft"] / 600 < 0.62
    assert 0.19 < count["directional"] / 600 < 0.31
    hard = Counter(drawn(seed, HARD_LIGHT).kind for seed in range(600))
    for kind in ("studio", "backlit", "silhouette", "night"):
        assert hard[kind] > count[kind]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("base", [LightConfig(), HARD_LIGHT], ids=["default", "hard"])
def test_a_white_ball_is_as_bright_as_stated(kind: str, base: LightConfig) -> None:
    weights = {f"{each}_weight": float(each == kind) for each in KINDS}
    config = replace(base, **weights)
    name = "illuminance" if kind in ("soft", "directional", "studio") else f"{kind}_illuminance"
    low, high = getattr(config, name)
    for seed in range(40):
        light = drawn(seed, config)
        lamps = tuple((np.array(lamp.direction), np.array(lamp.colour)) for lamp in light.lamps)
        ambient, by_lamps = seen_illuminance(np.array(light.ambient).reshape(9, 3), lamps)
        found = float(LUMINANCE @ (ambient + by_lamps))
        assert abs(found - light.illuminance) < 0.01 * found + 1e-3
        # Lamps folded into harmonics, and lamps held to the largest, may move it a little.
        assert 0.6 * low < found < 1.3 * high
        assert all(LUMINANCE @ np.array(lamp.colour) <= config.largest_lamp * 1.01 for lamp in light.lamps)


def test_few_faces_are_left_in_the_dark_by_default() -> None:
    found = np.array([drawn(seed).illuminance for seed in range(1000)])
    assert (found < 0.1).mean() < 0.02
    assert (found < 0.2).mean() < 0.06
    assert np.median(found) > 0.5


def test_lamps_stand_where_the_kind_wants_them() -> None:
    for seed in range(30):
        assert abs(drawn(seed, only("directional", mixture_share=0.0)).key_azimuth_deg) < 150
        behind = drawn(seed, only("backlit", mixture_share=0.0))
        first = max(behind.lamps, key=lambda lamp: LUMINANCE @ np.array(lamp.colour))
        assert behind.lamps[0] == first
    behind = [abs(drawn(seed, only("backlit")).key_azimuth_deg) for seed in range(60)]
    assert np.median(behind) > 130
    shares = [drawn(seed, only("directional")).key_share for seed in range(60)]
    assert np.median(shares) > 0.35
    assert max(drawn(seed, only("soft")).key_share for seed in range(60)) < 0.3


@pytest.mark.parametrize("name", sorted({**GENTLE_SETUPS, **HARSH_SETUPS}))
def test_every_arrangement_of_lamps_lights_the_front(name: str) -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        setup = build_setup(name, rng, Colours(rng, 2500.0, 10000.0, 5500.0))
        ambient, by_lamps = seen_illuminance(setup.ambient, tuple((lamp[0], lamp[1]) for lamp in setup.lamps))
        assert np.isfinite(ambient + by_lamps).all()
        assert LUMINANCE @ (ambient + by_lamps) > 0.02
        assert all((lamp[1] >= 0).all() for lamp in setup.lamps)


def test_directions_follow_the_camera() -> None:
    """Light from the picture's right falls on the face's left side, and on its front where the head looks there."""
    light = drawn(3, only("directional"))
    right = replace(light.lamps[0], direction=(1.0, 0.0, 0.0))
    light = replace(light, lamps=(right,))
    np.testing.assert_allclose(light_uniforms(light, camera())["light_direction"][0], [1, 0, 0], atol=1e-6)
    turned_head = camera(yaw=-90)  # looks to the picture's right
    np.testing.assert_allclose(light_uniforms(light, turned_head)["light_direction"][0], [0, 0, 1], atol=1e-6)
    upside_down = camera(roll=180)
    np.testing.assert_allclose(light_uniforms(light, upside_down)["light_direction"][0], [-1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(shadow_lights(light, turned_head)[0], [0, 0, 1], atol=1e-6)


@pytest.mark.parametrize("seed", range(12))
def test_what_is_seen_does_not_depend_on_how_the_head_is_turned(seed: int) -> None:
    """A ball in place of the head: its normals are turned with the camera, its light stays."""
    light = drawn(seed, HARD_LIGHT)
    in_picture = fibonacci_sphere(12)
    seen = []
    for each in (camera(), camera(70, 20, -130)):
        rotation = each.matrix[:3, :3] / np.linalg.norm(each.matrix[0, :3])
        rotation[2] = np.cross(rotation[0], rotation[1])
        seen.append(white_surface(light_uniforms(light, each)["light_sh"].astype(np.float64), in_picture @ rotation))
    np.testing.assert_allclose(*seen, atol=1e-5)


def test_shadows_are_asked_for_lamps_that_are_there_and_the_sky() -> None:
    for seed in range(30):
        light = drawn(seed)
        towards = shadow_lights(light, camera(30, 10, 5))
        assert towards.shape == (3, 3)
        lengths = np.linalg.norm(towards, axis=1)
        np.testing.assert_allclose(
            lengths, [*([1.0] * len(light.lamps)), *([0.0] * (2 - len(light.lamps))), 1], atol=1e-5
        )


def test_textures_hold_every_environment_without_its_lamps() -> None:
    texture = light_textures()["light_panoramas"]
    assert texture.pixels.dtype == np.float16
    assert texture.pixels.shape == (2 * len(environment_names()), 64, 128, 3)
    assert np.isfinite(texture.pixels).all()
    place = environment_names().index("sky")
    assert texture.pixels[2 * place].max() < 0.2 * light_panorama("sky").max()
    assert light_textures() is light_textures()


def test_patterns_before_lamps_lie_across_the_light() -> None:
    found = [drawn(seed, only("directional", gobo_share=1.0)) for seed in range(20)]
    assert {light.gobo.kind for light in found if light.gobo} == {"blinds", "leaves", "bars"}
    for light in found:
        uniforms = light_uniforms(light, camera(40))
        axes = uniforms["light_gobo_axes"].astype(np.float64)
        np.testing.assert_allclose(axes @ uniforms["light_direction"][0], 0, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(axes, axis=1) * light.gobo.period_mm, 1, rtol=1e-5)
    assert light_uniforms(drawn(0, only("soft")), camera())["light_gobo"] == 0


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({f"{kind}_weight": 0.0 for kind in KINDS}, "above 0"),
        ({"night_illuminance": (0.0, 0.5)}, "night_illuminance"),
        ({"key_share": (0.5, 1.2)}, "key_share"),
        ({"lamp_temperature_k": (10.0, 5000.0)}, "lamp_temperature_k"),
    ],
)
def test_a_configuration_that_makes_no_sense_is_refused_by_name(change: dict[str, object], named: str) -> None:
    with pytest.raises(UsageError, match=rf"light\..*{named}|{named}.*"):
        draw_light(np.random.default_rng(0), replace(LightConfig(), **change))
