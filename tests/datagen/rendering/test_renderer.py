"""What the renderer makes of cameras, sizes and landmarks; test_renderer_exactness compares it with the oracle."""

import numpy as np
import pytest

from datagen.opengl.gl_context import GLContext
from datagen.rendering.renderer import Renderer, visible_landmarks
from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    WeakPerspective,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import builtin_model
from pix2face.models.rasterise import render_maps
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.gl

LIMIT_MM = 0.02


def test_pictures_need_not_be_square_and_sizes_share_the_model(gl: GLContext) -> None:
    model = small_head_model()
    camera = weak_perspective_camera(WeakPerspective(0.3, rotation_of_pose(HeadPose(0, 20, 0)), np.array([60.0, 30])))
    first = Renderer(model, 64, 64, gl)
    for height, width in ((64, 120), (120, 64), (33, 71)):
        rendered = first.with_size(height, width).render(model.mean, camera)
        expected = render_maps(model, model.mean, camera, height, width)
        assert rendered["mask"].shape == (height, width)
        assert (rendered["mask"] != expected["mask"]).sum() <= 1
        error = np.abs(rendered["pncc"] - expected["pncc"])[rendered["mask"] & expected["mask"]]
        assert np.quantile(error, 0.999) < LIMIT_MM


def test_a_mirrored_camera_renders_the_mirrored_maps(gl: GLContext) -> None:
    model = small_head_model()
    camera = weak_perspective_camera(WeakPerspective(0.3, rotation_of_pose(HeadPose(0, 40, 0)), np.full(2, 32.0)))
    renderer = Renderer(model, 64, 64, gl)
    straight = renderer.render(model.mean, camera)
    mirrored = renderer.render(model.mean, camera.transformed(np.array([[-1.0, 0, 64], [0, 1, 0], [0, 0, 1]])))
    assert (mirrored["mask"][:, ::-1] != straight["mask"]).sum() <= 2
    both = mirrored["mask"][:, ::-1] & straight["mask"]
    assert np.abs(mirrored["pncc"][:, ::-1] - straight["pncc"])[both].max() < 0.05


def test_the_far_ear_is_hidden_by_the_head(gl: GLContext) -> None:
    model = builtin_model()
    camera = weak_perspective_camera(WeakPerspective(0.8, rotation_of_pose(HeadPose(0, 90, 0)), np.full(2, 128.0)))
    rendered = Renderer(model, 256, 256, gl).render(model.mean, camera)
    assert rendered["mask"].sum() > 5000
    # The face looks to the picture's left, so the subject's left half (x > 0) is the near one.
    assert (rendered["pncc"][rendered["mask"]][:, 0] > -8).mean() > 0.99
    landmarks = model.landmarks[IBUG68]
    visible = visible_landmarks(model.mean, landmarks, camera, rendered["surface_depth"])
    assert visible[[12, 14, 16, 45, 54]].all()
    assert not visible[[0, 2, 4, 36, 48]].any()


def test_landmarks_outside_the_picture_are_not_visible(gl: GLContext) -> None:
    model = builtin_model()
    camera = weak_perspective_camera(WeakPerspective(0.8, rotation_of_pose(HeadPose(0, 0, 0)), np.array([128.0, 10])))
    rendered = Renderer(model, 256, 256, gl).render(model.mean, camera)
    landmarks = model.landmarks[IBUG68]
    outside = camera.project(model.mean[landmarks])[:, 1] < 0
    assert outside.any()
    assert not visible_landmarks(model.mean, landmarks, camera, rendered["surface_depth"])[outside].any()


def test_impossible_requests_are_named(gl: GLContext) -> None:
    model = small_head_model()
    renderer = Renderer(model, 32, 32, gl)
    with pytest.raises(UsageError, match="expected images of 1 to"):
        renderer.with_size(0, 32)
    with pytest.raises(UsageError, match="expected images of 1 to"):
        renderer.with_size(32, 1_000_000)
    near = Camera(np.array([[50.0, 0, 16, 320], [0, -50, 16, 320], [0, 0, -1, 20], [0, 0, -1, 20]]))
    with pytest.raises(DegenerateGeometryError, match="in front of the camera"):
        renderer.render(model.mean, near)
