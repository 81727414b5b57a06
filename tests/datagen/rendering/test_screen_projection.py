"""Projection to the screen and back, for both kinds of camera."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from datagen.rendering.screen_projection import project_to_screen
from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.camera import Camera, HeadPose, Pinhole, linearised, pinhole_camera, rotation_of_pose
from tests.synthetic_models import small_head_model

MODEL = small_head_model()


def camera_of(angles: tuple[float, float, float], distance_mm: float, is_affine: bool) -> Camera:
    rotation = rotation_of_pose(HeadPose(*angles))
    camera = pinhole_camera(
        Pinhole(0.5 * distance_mm, np.array([70.0, 50]), rotation, np.array([4.0, -7, distance_mm]))
    )
    return linearised(camera) if is_affine else camera


@settings(max_examples=40)
@given(angles=st.tuples(*[st.floats(-180, 180)] * 3), distance_mm=st.floats(300, 1e5), is_affine=st.booleans())
def test_the_way_back_leads_to_the_vertices(
    angles: tuple[float, float, float], distance_mm: float, is_affine: bool
) -> None:
    camera = camera_of(angles, distance_mm, is_affine)
    found = project_to_screen(camera, MODEL.mean, 100, 140)
    column, row, order = found.screen[:, :3].astype(np.float64).T
    np.testing.assert_allclose(found.screen[:, :2], camera.project(MODEL.mean), atol=1e-4)
    relative = order / (1 - order * found.inverse_distance)
    np.testing.assert_allclose(found.reference_mm + relative, camera.depth(MODEL.mean), rtol=1e-6, atol=1e-3)
    across = np.outer(column - found.middle[0], found.along_column) + np.outer(row - found.middle[1], found.along_row)
    along = relative[:, None] * (found.along_depth + found.inverse_distance * across)
    np.testing.assert_allclose(found.middle_point + across + along, MODEL.mean, atol=2e-3)


def test_the_box_has_all_pixels_whose_centre_the_face_can_cover() -> None:
    camera = camera_of((0, 20, 0), 500, False)
    left, top, right, bottom = project_to_screen(camera, MODEL.mean, 1000, 1000).box_px
    low, high = camera.project(MODEL.mean).min(axis=0), camera.project(MODEL.mean).max(axis=0)
    assert (left, top) == tuple(np.floor(np.maximum(low, 0)))
    assert (right, bottom) == tuple(np.ceil(high))
    left, top, right, bottom = project_to_screen(camera, MODEL.mean, 20, 30).box_px
    assert 0 <= left <= right <= 30
    assert 0 <= top <= bottom <= 20


def test_numbers_beyond_float32_are_refused() -> None:
    far = Camera(np.array([[1e39, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]))
    with pytest.raises(DegenerateGeometryError, match="expected finite vertices and camera"):
        project_to_screen(far, MODEL.mean, 10, 10)
