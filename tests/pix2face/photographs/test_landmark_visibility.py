import numpy as np
import pytest

from pix2face.geometry.camera import Camera
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import builtin_model
from pix2face.models.rasterise import render_maps
from pix2face.photographs.landmark_visibility import visible_vertices
from tests.cameras import posed_camera

SIZE_PX = 200


def camera_of(yaw_deg: float) -> Camera:
    return posed_camera(SIZE_PX / 2, SIZE_PX / 2, yaw_deg=yaw_deg, scale=0.7)


@pytest.mark.parametrize("yaw_deg", [-70.0, -20.0, 0.0, 45.0, 90.0])
def test_what_is_visible_is_what_a_renderer_shows(yaw_deg):
    """The oracle: the depth of the rendered surface at the vertices' pixels; those near an edge of it are left out."""
    model, camera = builtin_model(), camera_of(yaw_deg)
    chosen = np.random.default_rng(0).choice(np.flatnonzero(model.is_face_vertex), 300, replace=False)
    visible = visible_vertices(model.mean, model.triangles, camera, chosen, tolerance_mm=3)
    surface = render_maps(model, model.mean, camera, SIZE_PX, SIZE_PX)["surface_depth"]
    column, row = np.floor(camera.project(model.mean[chosen])).astype(int).T
    around = np.stack([surface[row + down, column + right] for down in (-1, 0, 1) for right in (-1, 0, 1)])
    ahead = camera.depth(model.mean[chosen]) - around
    surely_visible, surely_hidden = (ahead < 3).all(axis=0), (ahead > 8).all(axis=0)
    assert surely_visible.sum() > 60
    assert surely_hidden.sum() > 5
    assert visible[surely_visible].all()
    assert not visible[surely_hidden].any()


def test_a_frontal_face_shows_its_landmarks_and_a_profile_half_of_them():
    model = builtin_model()
    landmarks = model.landmarks[IBUG68]
    frontal = visible_vertices(model.mean, model.triangles, camera_of(0), landmarks)
    assert frontal[17:].all()
    # Positive yaw turns the subject's right side away or towards the camera: the mirror image shows the other half.
    one, other = (visible_vertices(model.mean, model.triangles, camera_of(yaw), landmarks) for yaw in (80, -80))
    assert 20 < one.sum() < 48
    assert one[36] != one[45]
    assert other[36] == one[45]
    assert other[45] == one[36]


def test_lips_do_not_hide_the_corners_of_a_smiling_mouth():
    model = builtin_model()
    corners = model.landmarks[IBUG68][[48, 54, 60, 64]]
    smile = sum(model.named_expressions[name] for name in ("mouthSmileLeft", "mouthSmileRight"))
    vertices = model.vertices(np.zeros((1, model.n_identity), np.float32), smile[None].astype(np.float32))[0]
    assert not visible_vertices(vertices, model.triangles, camera_of(0), corners, tolerance_mm=1)[2:].any()
    assert visible_vertices(vertices, model.triangles, camera_of(0), corners).all()


def test_a_triangle_in_front_hides_and_one_behind_does_not():
    vertices = np.array([[0, 0, 0], [-9, -9, 5], [9, -9, 5], [0, 9, 5]], dtype=float)
    triangles = np.array([[1, 2, 3]])
    camera = posed_camera(0, 0)
    assert not visible_vertices(vertices, triangles, camera, np.array([0]))[0]
    vertices[1:, 2] = -5
    assert visible_vertices(vertices, triangles, camera, np.array([0]))[0]
