"""What is measured of a face, and which limits it passes."""

import numpy as np
import pytest

from pix2face.geometry.believable_face import GIVEN, PROJECTED, SET_BY_HAND, facing_deg, measure_face
from pix2face.geometry.camera import Camera, HeadPose, Pinhole, pinhole_camera, rotation_of_pose
from tests.cameras import posed_camera


def turned(pitch_deg: float, yaw_deg: float, roll_deg: float = 0) -> Camera:
    return posed_camera(50, 50, pitch_deg=pitch_deg, yaw_deg=yaw_deg, roll_deg=roll_deg, scale=2)


@pytest.mark.parametrize(
    ("pose", "expected"),
    [((0, 0), 0), ((0, 60), 60), ((-60, 0), 60), ((0, 90, 45), 90), ((10, 180), 170), ((0, 0, 180), 0)],
)
def test_facing_is_the_angle_to_the_camera_whatever_the_roll(pose: tuple[float, ...], expected: float) -> None:
    assert facing_deg(turned(*pose)) == pytest.approx(expected, abs=1e-5)


def test_facing_through_a_pinhole() -> None:
    rotation = rotation_of_pose(HeadPose(0, 40, 0))
    camera = pinhole_camera(Pinhole(900.0, np.full(2, 128.0), rotation, np.array([0.0, 0, 900])))
    assert facing_deg(camera) == pytest.approx(40, abs=1e-6)


def test_a_random_face_is_as_far_from_the_mean_as_random_faces_are() -> None:
    rng = np.random.default_rng(0)
    for n in (10, 124, 400):
        found = [measure_face(turned(0, 0), rng.normal(size=n), np.zeros((0, 2)), (9, 9)) for _ in range(500)]
        assert abs(np.mean([one.coefficients for one in found])) < 0.3
        assert max(one.coefficients for one in found) < 4
        assert not any(one.problems(SET_BY_HAND) for one in found)


@pytest.mark.parametrize(
    ("limits", "facing", "distance"), [(SET_BY_HAND, 100, 15), (PROJECTED, 120, 15), (GIVEN, 120, 25)]
)
def test_each_limit_counts(limits, facing, distance) -> None:
    inside, outside = np.array([[5.0, 5]]), np.array([[5.0, 11]])
    landmarks2d = np.concatenate([inside, inside, outside])

    def problems(yaw_deg: float, distance: float, landmarks2d: np.ndarray) -> list[str]:
        coefficients = np.zeros(100)
        coefficients[3] = 10 + distance
        return measure_face(turned(0, yaw_deg), coefficients, landmarks2d, (10, 20)).problems(limits)

    assert problems(facing - 0.1, distance - 0.1, landmarks2d) == []
    (found,) = problems(facing + 0.6, 0, landmarks2d)
    assert f"looks {facing + 1}° away from the camera (at most {facing}°)" in found
    (found,) = problems(0, distance + 1, landmarks2d)
    assert f"up to {distance + 11}.0 standard deviations" in found
    (found,) = problems(0, 0, np.concatenate([landmarks2d, outside, outside]))
    assert found.startswith("60 % of the landmarks are outside")
    assert len(problems(180, 99, outside)) == 3


def test_what_is_not_finite_is_a_problem() -> None:
    found = measure_face(turned(0, 0), np.array([np.nan, 0]), np.array([[np.nan, 1]]), (10, 10))
    assert len(found.problems(GIVEN)) == 2
