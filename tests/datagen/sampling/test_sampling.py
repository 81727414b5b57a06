"""Sampling: plausible, framed, and reproducible."""

import numpy as np
import pytest

from datagen.random_streams import generator_for
from datagen.sampling.faces import SampledView, draw_expression, draw_view, sample_faces
from datagen.sampling.sampling_config import DEFAULT_GEOMETRY
from pix2face.evaluation.benchmarks.manifest import load_manifest
from pix2face.face_files.coefficients import FaceCoefficients
from pix2face.geometry.camera import Camera, head_pose, pinhole_of, published_pose
from pix2face.geometry.crops import FaceBox
from pix2face.models.morphable_model import builtin_model
from tests.synthetic_models import small_head_model


@pytest.fixture(scope="module")
def table() -> FaceCoefficients:
    return sample_faces(small_head_model(), 300, 0, 128)


def test_the_first_faces_of_a_longer_draw_are_those_of_a_shorter(table: FaceCoefficients) -> None:
    short = sample_faces(small_head_model(), 20, 0, 128)
    np.testing.assert_array_equal(short.identity, table.identity[:20])
    np.testing.assert_array_equal(short.cameras, table.cameras[:20])
    assert short.sample_ids == table.sample_ids[:20]


def test_the_heldout_split_is_what_its_own_command_draws() -> None:
    manifest = load_manifest("builtin-heldout")
    assert manifest.seed is not None
    assert f"datagen sample --n {manifest.n_samples} --seed {manifest.seed} " in manifest.obtain
    drawn = sample_faces(small_head_model(), manifest.n_samples, manifest.seed, 128)
    assert drawn.sample_ids == manifest.sample_ids


def test_seed_zero_is_a_seed_and_seeds_differ(table: FaceCoefficients) -> None:
    np.testing.assert_array_equal(sample_faces(small_head_model(), 5, 0, 128).identity, table.identity[:5])
    assert not np.allclose(sample_faces(small_head_model(), 5, 1, 128).identity, table.identity[:5])


def test_identities_are_standard_normal_within_the_cut(table: FaceCoefficients) -> None:
    assert np.abs(table.identity).max() <= 2.5
    assert abs(float(table.identity.std()) - 1) < 0.08


def test_faces_fill_the_stated_part_of_the_picture(table: FaceCoefficients) -> None:
    model = small_head_model()
    vertices = model.vertices(table.identity, table.expression)[:, model.landmarks["ibug68"]]
    for points, matrix in zip(vertices, table.cameras, strict=True):
        box = FaceBox.around(Camera(matrix).project(points))
        # Perspective at arm's length enlarges what is near beyond the orthographic framing.
        assert 128 / 2.4 < box.longer_side < 128 / 1.1
        assert np.abs(box.centre - 64).max() < 30


def test_poses_and_distances_cover_what_the_module_says(table: FaceCoefficients) -> None:
    pinholes = [pinhole_of(Camera(matrix)) for matrix in table.cameras]
    for pinhole in pinholes:
        np.testing.assert_allclose(pinhole.principal_point_px, 64, atol=1e-6)
    depths = np.array([pinhole.translation_mm[2] for pinhole in pinholes])
    assert depths.min() > 250
    assert depths.max() < 4200
    yaws = np.array([head_pose(Camera(matrix)).yaw_deg for matrix in table.cameras])
    assert np.percentile(np.abs(yaws), 95) > 60
    assert np.median(np.abs(yaws)) < 35
    assert abs(float(np.mean(yaws))) < 8


def test_profiles_have_their_yaw_and_no_pitch_of_their_backs() -> None:
    cameras = [Camera(matrix) for matrix in sample_faces(builtin_model(), 300, 0, 64, DEFAULT_GEOMETRY).cameras]
    poses = [head_pose(camera) for camera in cameras]
    assert max(abs(pose.pitch_deg) for pose in poses) <= 90
    beyond = [pose for pose in poses if abs(pose.yaw_deg) > 90]
    assert len(beyond) > 3
    assert sum(abs(published_pose(camera).pitch_deg) > 90 for camera in cameras) == len(beyond)


def draws(n: int) -> list[SampledView]:
    return [draw_view(generator_for(5, str(index))) for index in range(n)]


def test_views_are_distributed_as_the_module_says() -> None:
    views = draws(6000)
    yaw, pitch, roll = np.array([(view.pose.yaw_deg, view.pose.pitch_deg, view.pose.roll_deg) for view in views]).T
    # P(|yaw| > 60) = 0.4 * 30/90 + 0.6 * 2 Phi(-60/18); P(|yaw| < 18) = 0.4 * 18/90 + 0.6 * 0.683
    assert abs((np.abs(yaw) > 60).mean() - 0.134) < 0.02
    assert abs((np.abs(yaw) < 18).mean() - 0.490) < 0.025
    assert np.abs(yaw).max() <= 90
    for angle, limit in ((pitch, 40), (roll, 45)):
        assert np.abs(angle).max() <= limit
        assert abs(angle.std() - 12) < 0.6
        assert abs(angle.mean()) < 0.6
    log_distance = np.log([view.distance_mm for view in views])
    assert abs(log_distance.mean() - np.log([350, 4000]).mean()) < 0.05
    assert log_distance.min() > np.log(349)
    assert log_distance.max() < np.log(4001)
    scale = np.array([view.picture_per_box for view in views])
    assert 1.5 <= scale.min() < 1.51
    assert 2.09 < scale.max() <= 2.1
    assert np.abs([view.shift for view in views]).max() <= 0.1


def test_expressions_of_both_sides_come_together() -> None:
    model = builtin_model()
    left, right = (model.named_expressions[f"eyeBlink{side}"].astype(np.float64) for side in ("Left", "Right"))
    drawn = np.stack([draw_expression(model, generator_for(0, str(index))) for index in range(800)])
    neutral = ~drawn.any(axis=1)
    assert abs(neutral.mean() - 0.2) < 0.05
    # What draws hold of both lids closing alike, and of one closing more than the other.
    along = drawn @ np.linalg.pinv(np.stack([left + right, left - right]))
    together, apart = np.abs(along).T
    active = together > 0.2
    assert active.sum() > 20
    assert np.median(apart[active] / together[active]) < 0.5
