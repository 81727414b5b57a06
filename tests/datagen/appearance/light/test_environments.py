"""Environments: harmonics against numerical integration, lamps and rest against the whole, places, colours."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from datagen.appearance.light.environment_light import add_environment
from datagen.appearance.light.environments import (
    environment,
    environment_names,
    light_panorama,
    panorama_grid,
    panorama_place,
    picture_panorama,
    softened_panorama,
)
from datagen.appearance.light.harmonics import (
    COSINE_BANDS,
    fibonacci_sphere,
    harmonics_at,
    point_light,
    project_radiance,
    turned,
    white_surface,
)
from datagen.appearance.light.light_colour import LUMINANCE, balance_matrix, black_body, saturation_matrix
from datagen.appearance.light.light_sources import (
    PanoramaLight,
    environment_from_camera,
)
from datagen.appearance.light.setups import Setup

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def integrated(panorama: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Irradiance / pi, texel by texel."""
    directions, solid_angles = panorama_grid(*panorama.shape[:2])
    cosine = np.maximum(directions.reshape(-1, 3) @ normals.T, 0)
    return cosine.T @ (panorama.reshape(-1, 3) * solid_angles.reshape(-1, 1)) / np.pi


@pytest.mark.parametrize("name", ["apartment", "forest", "venice", "studio", "sky", "night"])
def test_harmonics_and_lamps_light_a_white_surface_as_the_panorama_does(name: str) -> None:
    normals = fibonacci_sphere(60)
    exact = integrated(light_panorama(name).astype(np.float64), normals)
    taken_apart = environment(name)
    found = white_surface(taken_apart.harmonics, normals)
    for lamp in taken_apart.lamps:
        found += np.maximum(normals @ lamp.direction, 0)[:, None] * lamp.colour
    # Order 2 leaves a few per cent of the irradiance (Ramamoorthi and Hanrahan), lamps' sizes a little more.
    error = np.abs(found - exact).mean() / exact.mean()
    assert error < 0.05
    # Without the lamps taken out, the error of a sunny sky is larger: what they are taken out for.
    flat = panorama_grid(64, 128)
    whole = project_radiance(flat[0].reshape(-1, 3), light_panorama(name).reshape(-1, 3), flat[1].reshape(-1))
    if name in ("sky", "studio"):
        assert np.abs(white_surface(whole, normals) - exact).mean() / exact.mean() > error


def test_harmonics_give_back_light_that_they_can_express() -> None:
    rng = np.random.default_rng(1)
    harmonics = rng.normal(size=(9, 3))
    directions, solid_angles = panorama_grid(64, 128)
    flat = directions.reshape(-1, 3)
    radiance = harmonics_at(flat) @ harmonics
    np.testing.assert_allclose(project_radiance(flat, radiance, solid_angles.reshape(-1)), harmonics, atol=2e-3)
    # A white surface, before black is cut off: convolution with the cosine.
    normals = fibonacci_sphere(20)
    cosine = np.maximum(flat @ normals.T, 0)
    exact = cosine.T @ (radiance * solid_angles.reshape(-1, 1)) / np.pi
    np.testing.assert_allclose(harmonics_at(normals) @ (COSINE_BANDS[:, None] * harmonics), exact, atol=5e-3)


@settings(max_examples=20)
@given(st.integers(0, 10**6))
def test_turned_light_is_the_same_light_from_turned_directions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    harmonics, rotation = rng.normal(size=(9, 3)), Rotation.random(random_state=seed).as_matrix()
    directions = fibonacci_sphere(12)
    there = harmonics_at(directions @ rotation.T) @ turned(harmonics, rotation)
    np.testing.assert_allclose(there, harmonics_at(directions) @ harmonics, atol=1e-9)


@pytest.mark.parametrize("name", environment_names())
def test_lamps_and_rest_make_up_an_environment(name: str) -> None:
    taken_apart, panorama = environment(name), light_panorama(name).astype(np.float64)
    _, solid_angles = panorama_grid(*panorama.shape[:2])
    whole = np.tensordot(solid_angles, panorama, 2)
    rest = np.tensordot(solid_angles, taken_apart.rest.astype(np.float64), 2)
    lamps = np.pi * sum(lamp.colour for lamp in taken_apart.lamps)
    np.testing.assert_allclose(rest + lamps, whole, rtol=1e-4)
    assert (taken_apart.rest >= 0).all()
    assert all(abs(np.linalg.norm(lamp.direction) - 1) < 1e-9 for lamp in taken_apart.lamps)
    # Folded into harmonics, a lamp keeps its energy too.
    lamp = taken_apart.lamps[0]
    np.testing.assert_allclose(point_light(lamp.direction, lamp.colour)[0] * 4 * np.pi, np.pi * lamp.colour)


def test_the_sun_is_where_the_panorama_is_brightest() -> None:
    panorama = light_panorama("sky") @ LUMINANCE
    directions, _ = panorama_grid(*panorama.shape)
    brightest = directions[np.unravel_index(panorama.argmax(), panorama.shape)]
    assert environment("sky").lamps[0].direction @ brightest > np.cos(np.deg2rad(4))
    assert environment("sky").lamps[0].radius_rad < np.deg2rad(5)


def test_places_and_directions_of_a_panorama_agree_and_the_picture_is_the_light() -> None:
    directions, solid_angles = panorama_grid(8, 16)
    rows, columns = np.mgrid[:8, :16]
    np.testing.assert_allclose(panorama_place(directions, 8, 16), np.stack([columns, rows], axis=-1), atol=1e-9)
    assert abs(solid_angles.sum() - 4 * np.pi) < 1e-9
    for name in ("venice", "forest", "hall"):
        picture, light = picture_panorama(name), light_panorama(name)
        coarse = picture.reshape(64, 4, 128, 4, 3).mean(axis=(1, 3))
        dark = light.max(axis=2) < 1
        assert np.abs(coarse - light)[dark].mean() < 0.02 * light[dark].mean() + 0.01


def test_a_softened_panorama_keeps_its_light_and_knows_no_seam() -> None:
    panorama = light_panorama("venice")
    soft = softened_panorama(panorama, 0.2)
    assert abs(soft.mean() / panorama.mean() - 1) < 0.05
    assert soft.std() < panorama.std()
    across_seam = np.abs(soft[:, 0] - soft[:, -1]).mean()
    assert across_seam < 2 * np.abs(np.diff(soft, axis=1)).mean() + 1e-3
    moved = softened_panorama(np.roll(panorama, 40, axis=1), 0.2)
    np.testing.assert_allclose(np.roll(moved, -40, axis=1), soft, atol=1e-4)


def test_an_environment_turns_with_the_camera_that_looks_at_it() -> None:
    """At heading 0 the camera looks at the middle column; at 90 degrees at what was to its right."""
    for heading, column in ((0.0, 63.5), (90.0, 95.5)):
        panorama = PanoramaLight(name="sky", heading_deg=heading, tilt_deg=0, roll_deg=0, colour_matrix=IDENTITY)
        ahead = environment_from_camera(panorama) @ np.array([0.0, 0.0, 1.0])
        np.testing.assert_allclose(panorama_place(ahead, 64, 128), [column, 31.5], atol=1e-9)
    tilted = PanoramaLight(name="sky", heading_deg=0, tilt_deg=30, roll_deg=0, colour_matrix=IDENTITY)
    assert (environment_from_camera(tilted) @ np.array([0.0, 0.0, 1.0]))[1] < 0  # looks up


def test_turning_an_environment_turns_its_lamps_and_harmonics_alike() -> None:
    source = environment("sky")
    panorama = PanoramaLight(name="sky", heading_deg=200, tilt_deg=10, roll_deg=-5, colour_matrix=IDENTITY)
    setup = Setup()
    add_environment(setup, source, panorama)
    rotation = environment_from_camera(panorama)
    normals = fibonacci_sphere(10)
    np.testing.assert_allclose(
        white_surface(setup.ambient, normals), white_surface(source.harmonics, normals @ rotation.T), atol=1e-9
    )
    np.testing.assert_allclose(rotation @ setup.lamps[0][0], source.lamps[0].direction, atol=1e-9)


def test_black_bodies_are_red_when_cold_and_blue_when_hot() -> None:
    red_to_blue = [black_body(t)[0] / max(black_body(t)[2], 1e-9) for t in (2000, 3000, 5000, 6500, 10000)]
    assert (np.diff(red_to_blue) < 0).all()
    # Daylight is about white in sRGB; 2856 K is the standard lamp A, of chromaticity (0.4476, 0.4074).
    assert np.abs(black_body(6500) - 1).max() < 0.08
    # sRGB's primaries and white: IEC 61966-2-1.
    xyz_from_srgb = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = np.array(xyz_from_srgb) @ black_body(2856)
    np.testing.assert_allclose(xyz[:2] / xyz.sum(), [0.4476, 0.4074], atol=0.01)


def test_colours_are_corrected_without_a_change_of_brightness() -> None:
    colour = np.array([0.9, 0.5, 0.2])
    for saturation in (0.0, 0.5, 1.5):
        assert LUMINANCE @ saturation_matrix(saturation) @ colour == pytest.approx(LUMINANCE @ colour)
    grey = balance_matrix(colour, 1.0) @ colour
    assert np.ptp(grey) < 1e-9
    assert LUMINANCE @ grey == pytest.approx(LUMINANCE @ colour)
    np.testing.assert_allclose(balance_matrix(colour, 0.0), np.eye(3), atol=1e-12)
