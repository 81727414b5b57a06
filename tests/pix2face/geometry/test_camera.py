"""Cameras: every conversion and its way back."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy import ndarray
from scipy.spatial.transform import Rotation

from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.camera import (
    HeadPose,
    Pinhole,
    WeakPerspective,
    affine_camera,
    angle_between_poses_deg,
    head_pose,
    linearised,
    nearest_weak_perspective,
    pinhole_camera,
    pinhole_of,
    published_pose,
    rotation_of_pose,
    weak_perspective_camera,
)
from tests.cameras import posed_camera

angles = st.floats(-85, 85)
rotation_vectors = st.tuples(*[st.floats(-2, 2)] * 3)


def rotation_of(vector: tuple[float, ...]) -> ndarray:
    return Rotation.from_rotvec(vector).as_matrix()


@given(angles, st.floats(-179, 179), st.floats(-179, 179))
def test_a_pose_comes_back_from_its_camera_beyond_a_profile_too(pitch: float, yaw: float, roll: float) -> None:
    assume(abs(abs(yaw) - 90) > 1)  # seen from the side, pitch and roll are one angle
    camera = posed_camera(1, 1, pitch_deg=pitch, yaw_deg=yaw, roll_deg=roll, scale=1.7)
    found = head_pose(camera)
    atol = 1e-6 if abs(yaw) <= 85 else 1e-5
    np.testing.assert_allclose([found.pitch_deg, found.yaw_deg, found.roll_deg], [pitch, yaw, roll], atol=atol)
    published = published_pose(camera)
    assert abs(published.yaw_deg) <= 90
    np.testing.assert_allclose(rotation_of_pose(published), rotation_of_pose(found), atol=1e-9)
    assert published == found or abs(yaw) > 90


@given(st.tuples(*[st.floats(-4, 4)] * 3))
def test_stated_angles_are_within_their_ranges(vector: tuple[float, ...]) -> None:
    found = head_pose(weak_perspective_camera(WeakPerspective(2.0, rotation_of(vector), np.zeros(2))))
    assert abs(found.pitch_deg) <= 90
    assert max(abs(found.yaw_deg), abs(found.roll_deg)) <= 180
    np.testing.assert_allclose(rotation_of_pose(found), rotation_of(vector), atol=1e-7)


@given(st.tuples(*[st.floats(-4, 4)] * 3))
def test_published_poses_are_the_angles_that_scipy_finds(vector: tuple[float, ...]) -> None:
    rotation = rotation_of(vector)
    found = published_pose(weak_perspective_camera(WeakPerspective(2.0, rotation, np.zeros(2))))
    np.testing.assert_allclose(rotation_of_pose(found), rotation, atol=1e-7)
    expected = Rotation.from_matrix(np.diag([1, -1, -1]) @ rotation).as_euler("XYZ", degrees=True)
    if abs(expected[1]) < 89.9:
        difference = np.array([found.pitch_deg, found.yaw_deg, found.roll_deg]) + expected
        np.testing.assert_allclose((difference + 180) % 360, 180, atol=1e-6)  # -180 is 180


@pytest.mark.parametrize("yaw", [-90.0, 90.0])
def test_a_face_seen_exactly_from_the_side_has_a_pose(yaw: float) -> None:
    rotation = rotation_of_pose(HeadPose(20.0, yaw, 5.0))
    found = head_pose(weak_perspective_camera(WeakPerspective(1.0, rotation, np.zeros(2))))
    assert found.yaw_deg == pytest.approx(yaw, abs=1e-5)
    np.testing.assert_allclose(rotation_of_pose(found), rotation, atol=1e-6)


@given(rotation_vectors, st.floats(0.1, 10), st.floats(-500, 500))
def test_weak_perspective_comes_back(vector: tuple[float, ...], scale: float, shift: float) -> None:
    rotation = rotation_of(vector)
    found = nearest_weak_perspective(weak_perspective_camera(WeakPerspective(scale, rotation, np.array([shift, 3.0]))))
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-9)
    np.testing.assert_allclose([found.scale, *found.translation_px], [scale, shift, 3.0], atol=1e-9)


def test_the_parameters_that_users_of_a_camera_share_cannot_be_written_to() -> None:
    found = nearest_weak_perspective(weak_perspective_camera(WeakPerspective(2.0, np.eye(3), np.zeros(2))))
    for shared in (found.rotation, found.translation_px):
        with pytest.raises(ValueError, match="read-only"):
            shared[0] = 1


@given(rotation_vectors, st.floats(50, 5000), st.floats(200, 3000))
def test_pinhole_comes_back(vector: tuple[float, ...], focal: float, distance: float) -> None:
    given_pinhole = Pinhole(focal, np.array([120.0, 90.0]), rotation_of(vector), np.array([10.0, -20.0, distance]))
    found = pinhole_of(pinhole_camera(given_pinhole))
    assert found.focal_px == pytest.approx(focal)
    np.testing.assert_allclose(found.principal_point_px, [120, 90], atol=1e-6)
    np.testing.assert_allclose(found.rotation, given_pinhole.rotation, atol=1e-9)
    np.testing.assert_allclose(found.translation_mm, given_pinhole.translation_mm, atol=1e-6)


def test_pinhole_projects_as_the_textbook_says() -> None:
    rotation = rotation_of_pose(HeadPose(10, 20, 30))
    camera = pinhole_camera(Pinhole(800.0, np.array([128.0, 100.0]), rotation, np.array([5.0, 6.0, 700.0])))
    points = np.random.default_rng(0).normal(0, 60, (10, 3))
    seen = points @ rotation.T + [5, 6, 700]
    np.testing.assert_allclose(camera.project(points), 800 * seen[:, :2] / seen[:, 2:] + [128, 100])
    np.testing.assert_allclose(camera.depth(points), seen[:, 2])


def test_the_angle_between_poses_is_that_of_one_turn() -> None:
    straight = HeadPose(0, 0, 0)
    assert angle_between_poses_deg(straight, straight) == 0
    for turned in (HeadPose(30, 0, 0), HeadPose(0, -30, 0), HeadPose(0, 0, 30)):
        assert angle_between_poses_deg(straight, turned) == pytest.approx(30)
    assert angle_between_poses_deg(HeadPose(0, 0, 170), HeadPose(0, 0, -170)) == pytest.approx(20)
    # In profile pitch and roll turn about one axis: 40 degrees of both are no turn at all.
    assert angle_between_poses_deg(HeadPose(40, 90, 40), HeadPose(0, 90, 0)) == pytest.approx(0, abs=1e-4)


def test_a_frontal_head_is_upright_and_not_mirrored() -> None:
    camera = posed_camera(0, 0)
    left_ear, crown, nose = camera.project(np.array([[80.0, 0, 0], [0, 100, 0], [0, 0, 100]]))
    np.testing.assert_allclose([left_ear, crown, nose], [[80, 0], [0, -100], [0, 0]], atol=1e-12)
    assert camera.depth(np.array([[0.0, 0, 100]]))[0] < camera.depth(np.array([[0.0, 0, 0]]))[0]


def test_affine_depth_grows_away_from_the_viewer_in_mm() -> None:
    rotation = rotation_of_pose(HeadPose(15, -40, 5))
    weak = weak_perspective_camera(WeakPerspective(2.5, rotation, np.array([7.0, 8.0])))
    points = np.random.default_rng(1).normal(0, 60, (10, 3))
    np.testing.assert_allclose(affine_camera(weak.matrix[:2]).depth(points), weak.depth(points), atol=1e-9)


def test_linearised_camera_agrees_at_the_origin_to_first_order() -> None:
    camera = pinhole_camera(
        Pinhole(900.0, np.array([10.0, 20.0]), rotation_of((0.1, 0.4, -0.2)), np.array([3.0, 4, 800]))
    )
    flat, step = linearised(camera), 1e-3 * np.vstack([np.zeros(3), np.eye(3)])
    np.testing.assert_allclose(flat.project(step), camera.project(step), atol=1e-7)


def test_transformed_camera_follows_the_pixels() -> None:
    image_map = np.array([[0.5, 0.1, 3], [-0.1, 0.5, 7], [0, 0, 1]])
    points = np.random.default_rng(2).normal(0, 60, (10, 3))
    for camera in (
        pinhole_camera(Pinhole(900.0, np.array([10.0, 20.0]), rotation_of((0.1, 0.4, -0.2)), np.array([3.0, 4, 800]))),
        weak_perspective_camera(WeakPerspective(1.2, rotation_of((0.1, 0.4, -0.2)), np.array([3.0, 4]))),
    ):
        expected = camera.project(points) @ image_map[:2, :2].T + image_map[:2, 2]
        np.testing.assert_allclose(camera.transformed(image_map).project(points), expected, atol=1e-9)
        np.testing.assert_array_equal(camera.transformed(image_map).depth(points), camera.depth(points))


def test_degenerate_cameras_are_named() -> None:
    with pytest.raises(DegenerateGeometryError, match="parallel"):
        affine_camera(np.array([[1.0, 0, 0, 5], [2, 0, 0, 5]]))
    with pytest.raises(DegenerateGeometryError, match="affine"):
        pinhole_of(affine_camera(np.array([[1.0, 0, 0, 5], [0, 1, 0, 5]])))
