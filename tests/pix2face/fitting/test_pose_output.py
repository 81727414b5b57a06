"""Pose as 300W-LP writes it comes back from the camera that it makes, and from fits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.face_files.w300lp import PoseParameters, camera_of_pose, pose_of_camera
from pix2face.fitting.face_fit import fit_face
from pix2face.geometry.camera import (
    HeadPose,
    WeakPerspective,
    head_pose,
    nearest_weak_perspective,
    weak_perspective_camera,
)
from tests.fits import paper_fit
from tests.keypoint_model import points_of_pose
from tests.pix2face.fitting.rendered_faces import SIZE_PX, render_known_face
from tests.synthetic_models import small_head_model

MODEL = small_head_model()


@given(
    st.tuples(st.floats(-80, 80), st.floats(-89, 89), st.floats(-179, 179)),
    st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    st.floats(1e-5, 1e-2),
    st.integers(1, 2000),
)
def test_pose_comes_back(angles, translation, scale, height):
    pose = PoseParameters(head=HeadPose(*angles), translation_px=np.array([*translation, 0.0]), scale=scale)
    found = pose_of_camera(camera_of_pose(pose, height), height)
    np.testing.assert_allclose([found.head.pitch_deg, found.head.yaw_deg, found.head.roll_deg], angles, atol=1e-6)
    np.testing.assert_allclose(found.translation_px, pose.translation_px, atol=1e-8)
    assert found.scale == pytest.approx(scale)


def test_pose_parameters_of_a_fit_place_the_face_as_300w_lp_does():
    """Their formula (points_of_pose, in their 1-based pixels) with our numbers lands where our camera does."""
    face = render_known_face(MODEL, HeadPose(10, -35, 20), 4, perspective=False)
    fit = fit_face(face.maps, MODEL, paper_fit())
    pose = pose_of_camera(fit.camera, SIZE_PX)
    points = fit.vertices.astype(np.float64)
    posed = points_of_pose(1000 * points, pose, SIZE_PX)
    np.testing.assert_allclose(posed[:, :2] - 0.5, fit.camera.project(points), atol=1e-6)
    nearer = fit.camera.depth(points)
    assert np.corrcoef(posed[:, 2], -nearer)[0, 1] > 0.999999  # theirs grows towards the viewer
    assert pose.head.pitch_deg == pytest.approx(10, abs=0.1)
    assert pose.head.yaw_deg == pytest.approx(-35, abs=0.1)
    assert pose.head.roll_deg == pytest.approx(20, abs=0.1)


@pytest.mark.parametrize(
    ("pose", "moves"),
    [
        (HeadPose(30, 0, 0), lambda nose, crown: nose[1] < -5),  # positive pitch: the tip of the nose rises
        (HeadPose(0, 30, 0), lambda nose, crown: nose[0] < -5),  # positive yaw: it goes to the picture's left
        (HeadPose(0, 0, 30), lambda nose, crown: crown[0] > 5),  # positive roll: the crown goes to the right
    ],
)
def test_signs_in_words(pose, moves):
    face = render_known_face(MODEL, pose, 5, perspective=False, spread=0.3)
    camera = fit_face(face.maps, MODEL, paper_fit()).camera
    found = head_pose(camera)
    np.testing.assert_allclose(
        [found.pitch_deg, found.yaw_deg, found.roll_deg], [pose.pitch_deg, pose.yaw_deg, pose.roll_deg], atol=0.2
    )
    origin = camera.project(np.zeros(3))
    nose, crown = (camera.project(np.array(point)) - origin for point in ([0.0, 0, 110], [0.0, 110, 0]))
    assert moves(nose, crown)


def test_weak_perspective_of_a_fit_is_the_camera_itself():
    face = render_known_face(MODEL, HeadPose(0, 50, 0), 6, perspective=False)
    camera = fit_face(face.maps, MODEL, paper_fit(regularisation=1.0)).camera
    parameters = nearest_weak_perspective(camera)
    assert isinstance(parameters, WeakPerspective)
    np.testing.assert_allclose(weak_perspective_camera(parameters).matrix, camera.matrix, atol=1e-9)
