"""Normals of meshes: outward, weighted by area, and turned into the camera's frame."""

import numpy as np
import pytest

from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    Pinhole,
    WeakPerspective,
    pinhole_camera,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.models.surface_attributes import normals_in_camera, vertex_normals
from tests.synthetic_models import small_head_model

MODEL = small_head_model()


def test_normals_point_outward_and_have_unit_length() -> None:
    normals = vertex_normals(MODEL.mean, MODEL.triangles)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    smooth = MODEL.mean[:, 2] > 30
    towards = MODEL.mean / np.linalg.norm(MODEL.mean, axis=1, keepdims=True)
    assert np.einsum("vi,vi->v", normals, towards)[smooth].min() > 0.3
    isolated = np.vstack([MODEL.mean, [[0, 0, 0]]])
    assert not vertex_normals(isolated, MODEL.triangles)[-1].any()


def test_larger_triangles_count_more() -> None:
    vertices = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 1]], dtype=np.float32)
    triangles = np.array([[0, 1, 2], [0, 3, 1]])  # areas 8 and 2, facing +z and +y
    np.testing.assert_allclose(vertex_normals(vertices, triangles)[0], np.array([0, 2, 8]) / np.hypot(2, 8))


ROTATION = rotation_of_pose(HeadPose(10, 30, -20))


@pytest.mark.parametrize(
    "camera",
    [
        weak_perspective_camera(WeakPerspective(0.5, ROTATION, np.array([40.0, 30.0]))),
        pinhole_camera(Pinhole(200, np.array([40.0, 30.0]), ROTATION, np.array([3.0, -4.0, 500.0]))),
    ],
)
def test_normals_turn_with_the_camera(camera: Camera) -> None:
    expected = vertex_normals(MODEL.mean, MODEL.triangles) @ ROTATION.T
    np.testing.assert_allclose(normals_in_camera(MODEL, MODEL.mean, camera), expected, atol=1e-5)
