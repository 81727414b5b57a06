"""Sampling: plausible, framed, and reproducible."""

import numpy as np
import pytest

from datagen.sampling import sample_faces
from pix2face.camera import Camera, head_pose, pinhole_of
from pix2face.coefficients import FaceCoefficients
from pix2face.crops import FaceBox
from pix2face.errors import UsageError
from tests.synthetic_models import small_head_model


@pytest.fixture(scope="module")
def table() -> FaceCoefficients:
    return sample_faces(small_head_model(), 300, 0, 128)


def test_the_first_faces_of_a_longer_draw_are_those_of_a_shorter(table: FaceCoefficients) -> None:
    short = sample_faces(small_head_model(), 20, 0, 128)
    np.testing.assert_array_equal(short.identity, table.identity[:20])
    np.testing.assert_array_equal(short.cameras, table.cameras[:20])
    assert short.sample_ids == table.sample_ids[:20]


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


@pytest.mark.parametrize(("n", "seed", "size"), [(0, 0, 128), (5, -1, 128), (5, 0, 8)])
def test_impossible_requests_are_refused(n: int, seed: int, size: int) -> None:
    with pytest.raises(UsageError, match="expected n >= 1"):
        sample_faces(small_head_model(), n, seed, size)
