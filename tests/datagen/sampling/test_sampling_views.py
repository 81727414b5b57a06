"""Poses, cameras and crops: distributed as configured, framed as said."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datagen.cli import main
from datagen.random_streams import generator_for
from datagen.sampling.faces import sample_faces
from datagen.sampling.sampling_config import DEFAULT_GEOMETRY, HARD_GEOMETRY, GeometryConfig
from datagen.sampling.views import PhotographedView, camera_attributes, draw_photographed_view, photograph_face
from pix2face.errors import UsageError
from pix2face.face_files.coefficients import load_coefficients
from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, head_pose, pinhole_of, weak_perspective_camera
from pix2face.geometry.crops import FaceBox
from pix2face.models.morphable_model import builtin_model
from tests.synthetic_models import small_head_model


def views(n: int, config: GeometryConfig = DEFAULT_GEOMETRY) -> list[PhotographedView]:
    return [draw_photographed_view(generator_for(5, str(index)), config) for index in range(n)]


def landmarks() -> np.ndarray:
    model = builtin_model()
    return model.mean[model.landmarks["ibug68"]].astype(np.float64)


def test_views_are_distributed_as_configured() -> None:
    drawn = views(6000)
    pitch, yaw, roll = np.array([(v.pose.pitch_deg, v.pose.yaw_deg, v.pose.roll_deg) for v in drawn]).T
    # 0.4 * 45/70 of the wide, 0.1 * 45/110 of any (50 to 95), 0.5 * 2 Phi(-50/20) of the frontal ones
    expected = 0.4 * 45 / 70 + 0.1 * 45 / 110 + 0.5 * 0.0124
    assert abs(((np.abs(yaw) > 50) & (np.abs(yaw) <= 95)).mean() - expected) < 0.025
    assert abs((yaw > 0).mean() - 0.5) < 0.02
    assert np.abs(yaw).max() <= 110
    assert (np.abs(yaw) > 95).any()
    assert np.abs(pitch).max() <= 60
    assert abs((np.abs(pitch) > 42).mean() - 0.08 * 0.3 - 0.92 * 0.0027) < 0.01
    assert abs(roll.std() - 12) < 0.5
    turn = np.array([v.turn_deg for v in drawn])
    assert abs((turn != 0).mean() - 0.03) < 0.008
    assert np.abs(turn).max() > 150
    distance = np.array([v.distance_mm for v in drawn])
    assert 250 <= distance.min() < 260
    assert 7700 < distance.max() <= 8000
    assert abs((distance < 600).mean() - 0.25) < 0.02
    assert abs((distance > 2500).mean() - 0.25) < 0.02
    shift = np.abs([v.shift for v in drawn]).max(axis=1)
    assert abs((shift > 0.2).mean() - 0.05 * (1 - 0.4**2)) < 0.012


@pytest.mark.parametrize("config", [DEFAULT_GEOMETRY, HARD_GEOMETRY])
def test_every_view_frames_the_box_of_its_own_landmarks(config: GeometryConfig) -> None:
    points = landmarks()
    for view in views(300, config):
        box = FaceBox.around(photograph_face(points, view, 256).project(points))
        assert box.longer_side == pytest.approx(256 / view.picture_per_box, rel=1e-9)
        np.testing.assert_allclose(box.centre, 128 - np.array(view.shift) * box.longer_side, atol=1e-6)


def test_nothing_of_a_head_is_near_the_camera() -> None:
    model = builtin_model()
    for view in views(400, replace(HARD_GEOMETRY, distance_shares=(1.0, 0.0, 0.0))):
        assert photograph_face(landmarks(), view, 256).depth(model.mean).min() > 50


def test_the_principal_point_is_that_of_a_larger_photograph() -> None:
    view = PhotographedView(HeadPose(0, 0, 0), 0.0, 1000.0, (10.0, -5.0), 1.6, (0.0, 0.0))
    points = landmarks()
    camera = photograph_face(points, view, 256)
    pinhole = pinhole_of(camera)
    seen = points.mean(axis=0) @ pinhole.rotation.T + pinhole.translation_mm
    angles = np.rad2deg(np.arctan(seen[:2] / seen[2]))
    np.testing.assert_allclose(angles, [10, -5], atol=1e-9)
    # The face is to the right of the optical axis and above it: the axis is to the left of it and below.
    assert pinhole.principal_point_px[0] < 128 < pinhole.principal_point_px[1]
    stated = camera_attributes(camera)
    assert stated["focal_px"] == pytest.approx(pinhole.focal_px, abs=0.01)
    assert stated["principal_x_px"] == pytest.approx(pinhole.principal_point_px[0], abs=0.01)
    flat = weak_perspective_camera(WeakPerspective(1.0, np.eye(3), np.zeros(2)))
    assert camera_attributes(flat) == {}


@given(st.floats(-60, 60), st.floats(-75, 75), st.floats(-170, 170), st.tuples(st.floats(-15, 15), st.floats(-15, 15)))
def test_the_pose_is_what_the_camera_sees(pitch: float, yaw: float, roll: float, off_axis: tuple[float, float]) -> None:
    view = PhotographedView(HeadPose(pitch, yaw, roll), 0.0, 8000.0, off_axis, 1.6, (0.0, 0.0))
    found = head_pose(photograph_face(landmarks(), view, 256))
    for expected, angle in ((pitch, found.pitch_deg), (yaw, found.yaw_deg), (roll, found.roll_deg)):
        assert abs((angle - expected + 180) % 360 - 180) < 3.5


def test_a_turned_picture_is_the_picture_turned() -> None:
    points = landmarks()
    view = PhotographedView(HeadPose(10, 70, 5), 0.0, 800.0, (0.0, 0.0), 1.6, (0.0, 0.0))
    upright, turned = (photograph_face(points, v, 256) for v in (view, replace(view, turn_deg=90.0)))
    shapes = [camera.project(points) - camera.project(points).mean(axis=0) for camera in (upright, turned)]
    shapes = [shape / np.linalg.norm(shape) for shape in shapes]
    np.testing.assert_allclose(shapes[1], shapes[0][:, ::-1] * [-1, 1], atol=1e-9)  # clockwise: up goes to the right


def test_far_away_a_camera_is_as_good_as_affine_and_near_it_is_not() -> None:
    points = landmarks()
    spread = []
    for distance in (250.0, 8000.0):
        camera = photograph_face(points, PhotographedView(HeadPose(0, 0, 0), 0.0, distance, (0, 0), 1.6, (0, 0)), 256)
        depth = camera.depth(points)
        spread.append(depth.max() / depth.min())
    assert spread[0] > 1.3
    assert spread[1] < 1.02


def test_the_parts_of_a_face_have_streams_of_their_own() -> None:
    one = sample_faces(small_head_model(), 20, 0, 128, DEFAULT_GEOMETRY)
    other = sample_faces(small_head_model(), 20, 0, 128, replace(DEFAULT_GEOMETRY, wide_yaw_share=0.0))
    np.testing.assert_array_equal(one.identity, other.identity)
    np.testing.assert_array_equal(one.expression, other.expression)
    assert not np.allclose(one.cameras, other.cameras)


def test_configured_faces_are_the_same_for_longer_draws_and_say_how_they_were_drawn() -> None:
    long, short = (sample_faces(small_head_model(), n, 0, 128, HARD_GEOMETRY) for n in (30, 10))
    np.testing.assert_array_equal(long.cameras[:10], short.cameras)
    assert long.attributes[:10] == short.attributes
    assert json.loads(short.configuration)["geometry"]["wide_yaw_share"] == HARD_GEOMETRY.wide_yaw_share
    attributes = json.loads(short.attributes[0])
    pinhole = pinhole_of(Camera(short.cameras[0]))
    assert attributes["focal_px"] == pytest.approx(pinhole.focal_px, abs=0.01)


def test_identities_have_far_ones_but_are_else_normal() -> None:
    table = sample_faces(builtin_model(), 200, 0, 128, replace(DEFAULT_GEOMETRY, extreme_identity_share=0.5))
    far = (np.abs(table.identity[:, :10]) > 1.79).any(axis=1).mean()
    usual = sample_faces(builtin_model(), 200, 0, 128, replace(DEFAULT_GEOMETRY, extreme_identity_share=0.0))
    assert far > (np.abs(usual.identity[:, :10]) > 1.79).any(axis=1).mean() + 0.1
    assert np.abs(table.identity).max() <= 2.7
    assert abs(float(usual.identity.std()) - 1) < 0.03


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wide_yaw_share": 1.5}, "wide_yaw_share: expected a number from 0 to 1, found 1.5"),
        ({"wide_yaw_share": 0.8, "any_yaw_share": 0.4}, "wide_yaw_share: expected at most 1 together with any_yaw"),
        ({"distance_shares": (0.5, 0.6, 0.1)}, "distance_shares: expected 3 numbers from 0 to 1 that sum to 1"),
        ({"distances_mm": (100.0, 600.0, 2500.0, 8000.0)}, "distances_mm: expected 4 ascending numbers from 250"),
        ({"picture_per_box": (2.0, 1.0)}, "picture_per_box: expected 2 ascending"),
        ({"pitch_deg": float("nan")}, "pitch_deg: expected a number from 0, found nan"),
        ({"identity_spread": 2.0}, "identity_spread: expected a number from 0 to 1.3, found 2"),
    ],
)
def test_configurations_that_cannot_be_drawn_are_refused(changes: dict[str, object], message: str) -> None:
    config = replace(DEFAULT_GEOMETRY, **changes)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match=message):
        sample_faces(small_head_model(), 1, 0, 128, config)


def test_the_command_draws_what_a_file_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    appearance, table = tmp_path / "mine.toml", tmp_path / "faces.h5"
    appearance.write_text("[geometry]\nwide_yaw_share = 0.5\npicture_per_box = [1.4, 1.8]\n", encoding="utf-8")
    command = ["sample", "--n", "2", "--out", str(table), "--appearance"]
    assert main([*command, str(appearance)]) == 0
    config = replace(DEFAULT_GEOMETRY, wide_yaw_share=0.5, picture_per_box=(1.4, 1.8))
    expected = sample_faces(builtin_model(), 2, 0, 256, config)
    np.testing.assert_array_equal(load_coefficients(table).cameras, expected.cameras)
    assert main([*command, "plain"]) == 0
    np.testing.assert_array_equal(load_coefficients(table).cameras, sample_faces(builtin_model(), 2, 0, 256).cameras)
    appearance.write_text("[geometry]\nwide_yaw_share = 5.0\n", encoding="utf-8")
    capsys.readouterr()
    assert main([*command, str(appearance)]) == 2
    assert "geometry.wide_yaw_share: expected a number from 0 to 1, found 5.0" in capsys.readouterr().err
