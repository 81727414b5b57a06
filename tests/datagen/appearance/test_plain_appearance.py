"""Pictures of built-in faces: reproducible, on the face, in front of a background."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from scipy import ndimage

from datagen.appearance.backdrop.patterns import draw_background
from datagen.appearance.plain_appearance import develop, draw_plain_appearance
from datagen.opengl.gl_context import GLContext
from datagen.rendering.renderer import Renderer
from pix2face.errors import UsageError
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.models.morphable_model import builtin_model

SIZE = 128
CAMERA = weak_perspective_camera(WeakPerspective(0.5, rotation_of_pose(HeadPose(5, 20, 5)), np.full(2, SIZE / 2)))


def test_the_same_seed_draws_the_same_appearance_and_it_is_json() -> None:
    first, second = (draw_plain_appearance(np.random.default_rng(4)) for _ in range(2))
    assert first == second
    assert first != draw_plain_appearance(np.random.default_rng(5))
    assert json.loads(json.dumps(asdict(first)))["skin_rgb"] == list(first.skin_rgb)


def test_all_skin_tones_occur() -> None:
    brightness = [np.mean(draw_plain_appearance(np.random.default_rng(seed)).skin_rgb) for seed in range(300)]
    assert np.percentile(brightness, 5) < 0.35
    assert np.percentile(brightness, 95) > 0.65
    assert 0.3 < np.median(brightness) < 0.75


@pytest.mark.parametrize("seed", range(8))
def test_backgrounds_are_pictures_of_the_size_asked_for(seed: int) -> None:
    background = draw_background(np.random.default_rng(seed), 40, 56)
    assert background.shape == (40, 56, 3)
    assert background.dtype == np.uint8
    np.testing.assert_array_equal(background, draw_background(np.random.default_rng(seed), 40, 56))


@pytest.mark.gl
def test_the_head_covers_the_background_where_its_surface_is(gl: GLContext) -> None:
    model = builtin_model()
    renderer = Renderer(model, SIZE, SIZE, gl)
    covered = np.isfinite(renderer.render(model.mean, CAMERA)["surface_depth"])
    green = np.zeros((SIZE, SIZE, 3), np.uint8)
    green[..., 1] = 255
    for seed in range(5):
        image = renderer.render_image(model.mean, CAMERA, draw_plain_appearance(np.random.default_rng(seed)), green)
        is_background = (image == green).all(axis=-1)
        # Edges are averaged over half pixels: pixels on the border are of both, none within or beyond.
        assert not is_background[ndimage.binary_erosion(covered, np.ones((3, 3)))].any()
        assert is_background[~ndimage.binary_dilation(covered, np.ones((3, 3)))].all()
        assert image[covered].std() > 5


@pytest.mark.gl
def test_light_changes_the_picture_and_developing_keeps_its_mean(gl: GLContext) -> None:
    model = builtin_model()
    renderer = Renderer(model, SIZE, SIZE, gl)
    background = np.full((SIZE, SIZE, 3), 128, np.uint8)
    appearances = [draw_plain_appearance(np.random.default_rng(seed)) for seed in range(2)]
    images = [renderer.render_image(model.mean, CAMERA, appearance, background) for appearance in appearances]
    assert np.abs(images[0].astype(int) - images[1]).mean() > 3
    for image, appearance in zip(images, appearances, strict=True):
        developed = develop(image, appearance)
        assert developed.shape == image.shape
        assert abs(float(developed.mean()) - float(image.mean())) < 6


@pytest.mark.gl
def test_a_background_of_another_size_is_refused(gl: GLContext) -> None:
    model = builtin_model()
    with pytest.raises(UsageError, match="expected a background of"):
        Renderer(model, SIZE, SIZE, gl).render_image(
            model.mean, CAMERA, draw_plain_appearance(np.random.default_rng(0)), np.zeros((3, 3, 3), np.uint8)
        )
