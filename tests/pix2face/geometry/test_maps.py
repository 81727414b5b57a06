"""Maps: fixed point, the mask of predicted pixels, the point cloud."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pix2face.geometry.maps import (
    FaceMaps,
    fixed_point_to_maps,
    map_picture,
    point_cloud,
    smooth_maps,
    uncovered_points,
    valid_pixels,
)
from pix2face.shards.layers import LAYERS, to_stored

HALF_A_STEP_MM = 0.5 / 128
LIMIT = float(np.nextafter(np.float32(LAYERS["pncc"].limit), np.float32(0)))  # the last float32 within the range


@given(hnp.arrays(np.float32, (5, 4, 3), elements=st.floats(-LIMIT, LIMIT, width=32)))
def test_fixed_point_is_at_most_half_a_step_off(values_mm: np.ndarray) -> None:
    back = fixed_point_to_maps(to_stored(LAYERS["pncc"], values_mm))
    assert back.dtype == np.float32
    assert np.abs(back.astype(np.float64) - values_mm).max() <= HALF_A_STEP_MM


def pncc_of_length(length_mm: np.ndarray) -> np.ndarray:
    """A map whose points have the given distances from the origin, in various directions."""
    direction = np.array([0.6, -0.48, 0.64])
    return (length_mm[..., None] * direction).astype(np.float32)


@pytest.mark.parametrize(("factor", "is_face"), [(0.0, False), (0.499, False), (0.501, True), (5.0, True)])
def test_the_threshold_is_half_the_smallest_radius(factor: float, is_face: bool) -> None:
    pncc = pncc_of_length(np.full((5, 6), factor * 80))
    assert valid_pixels(pncc, 80.0)[1:-1, 1:-1].all() == is_face
    assert valid_pixels(pncc, 80.0).any() == is_face


def test_one_pixel_is_taken_off_where_the_face_ends_and_not_where_the_picture_does() -> None:
    lengths = np.full((6, 9), 100.0)
    assert valid_pixels(pncc_of_length(lengths), 60.0).all()
    lengths[:, :2] = 20.0
    expected = np.ones((6, 9), dtype=bool)
    expected[:, :3] = False
    np.testing.assert_array_equal(valid_pixels(pncc_of_length(lengths), 60.0), expected)


@given(hnp.arrays(np.bool_, (9, 8)))
def test_erosion_keeps_pixels_whose_eight_neighbours_are_face(far: np.ndarray) -> None:
    padded = np.pad(far, 1, mode="edge")
    neighbours = [padded[1 + dy : 10 + dy, 1 + dx : 9 + dx] for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    found = valid_pixels(pncc_of_length(np.where(far, 100.0, 20.0)), 60.0)
    np.testing.assert_array_equal(found, np.logical_and.reduce(neighbours))


def test_undefined_predictions_are_no_face() -> None:
    pncc = pncc_of_length(np.full((7, 7), 100.0))
    pncc[3, 3, 1] = np.nan
    found = valid_pixels(pncc, 60.0)
    assert not found[2:5, 2:5].any()
    assert found[1, 1]


def test_the_cloud_is_the_mean_point_plus_its_offset_in_the_colour_of_its_pixel() -> None:
    rng = np.random.default_rng(0)
    mask = rng.random((6, 5)) < 0.4
    pncc, offset = rng.normal(0, 50, (2, 6, 5, 3)).astype(np.float32)
    image = rng.integers(0, 256, (6, 5, 3)).astype(np.uint8)
    points, colours = point_cloud(FaceMaps(pncc, offset, mask), image)
    expected = [(pncc[i, j] + offset[i, j], image[i, j]) for i in range(6) for j in range(5) if mask[i, j]]
    assert len(points) == mask.sum() > 3
    np.testing.assert_array_equal(points, [point for point, _ in expected])
    np.testing.assert_array_equal(colours, [colour for _, colour in expected])


def test_the_cloud_of_no_face_is_empty() -> None:
    zeros = np.zeros((4, 4, 3), dtype=np.float32)
    points, colours = point_cloud(FaceMaps(zeros, zeros, np.zeros((4, 4), bool)), zeros.astype(np.uint8))
    assert points.shape == colours.shape == (0, 3)


def test_a_map_picture_shows_x_y_z_as_red_green_blue_and_grey_outside() -> None:
    values = np.array([[[-20, 0, 20], [-99, 99, 10], [20, 20, 20]]], dtype=np.float32)
    picture = map_picture(values, np.array([[True, True, False]]), 20.0)
    np.testing.assert_array_equal(picture, [[[0, 127, 255], [0, 255, 191], [128, 128, 128]]])


def test_points_are_covered_where_the_face_around_them_is_not_seen() -> None:
    mask, seen = np.zeros((2, 20, 30), dtype=bool)
    mask[5:15, 5:25] = True
    seen[5:10, 5:25] = True
    points = {
        (10.5, 7.5): True,  # on the face
        (10.5, 12.5): False,  # under the cloth
        (10.5, 10.5): True,  # at its edge
        (10.5, 15.5): False,  # a pixel outside the face, beside what is covered
        (10.5, 18.5): False,
        (10.5, 2.5): True,  # beside what is seen
        (10.5, 19.5): True,  # too far to be known
        (-3.0, 12.5): True,  # beside the picture
        (np.nan, 12.5): True,
        (1e30, 12.5): True,
        (29.9, 19.9): True,
    }
    found = uncovered_points(np.array(list(points)), mask, seen)
    assert found.tolist() == list(points.values())


def disc(size_px: int, radius_px: float) -> np.ndarray:
    """The pixels whose centre is near that of the square."""
    rows, columns = np.mgrid[:size_px, :size_px] + 0.5 - size_px / 2
    return np.asarray(np.hypot(rows, columns) < radius_px)


def ramp(size_px: int, mask: np.ndarray) -> np.ndarray:
    """Smooth values by the place in the square, which ends at -60 and 60 mm, whatever its size."""
    y, x = (np.mgrid[:size_px, :size_px] + 0.5) / size_px * 120 - 60
    return np.stack([x, y, x - y], axis=2).astype(np.float32) * mask[..., None]


@pytest.mark.parametrize("size_px", [64, 100, 256])
def test_smooth_maps_are_the_same_function_of_the_place_in_any_size(size_px: int) -> None:
    mask = disc(64, 25)
    found = smooth_maps(FaceMaps(ramp(64, mask), 0.1 * ramp(64, mask), mask), size_px)
    assert np.mean(found.mask != disc(size_px, 25 * size_px / 64)) < 0.01
    inside, everywhere = disc(size_px, 14 * size_px / 64), np.ones((size_px, size_px), dtype=bool)
    for values, expected in ((found.pncc, 1.0), (found.offset, 0.1)):
        assert (values.dtype, values.shape) == (np.float32, (size_px, size_px, 3))
        assert np.abs(values - expected * ramp(size_px, everywhere))[inside].max() < 0.2 * expected
        assert not values[~found.mask].any()


def test_smooth_maps_are_nearer_to_the_truth_than_blocks_and_noise() -> None:
    mask, rng = disc(64, 25), np.random.default_rng(0)
    truth = 0.2 * ramp(64, mask)
    noise = rng.normal(0, 2, (2, 64, 64, 3))
    blocks = np.repeat(np.repeat(rng.normal(0, 2, (16, 16, 3)), 4, axis=0), 4, axis=1)
    rough = [(truth + own).astype(np.float32) * mask[..., None] for own in (noise[0], blocks)]
    found = smooth_maps(FaceMaps(rough[0], rough[1], mask), 64)
    for before, after in ((rough[0], found.pncc), (rough[1], found.offset)):
        assert np.abs(after - truth)[mask].mean() < 0.6 * np.abs(before - truth)[mask].mean()


@pytest.mark.parametrize("radius_px", [4, 10, 16])
@pytest.mark.parametrize("has_holes", [True, False])
def test_holes_of_a_mask_are_kept_or_closed_with_values_from_around_them(has_holes: bool, radius_px: int) -> None:
    mask = disc(64, 25) & ~disc(64, radius_px)
    maps = FaceMaps(ramp(64, mask), ramp(64, mask), mask)
    found = smooth_maps(maps, 128, has_holes=has_holes)
    hole = disc(128, 2 * radius_px - 3)
    assert found.mask[hole].any() != has_holes
    if not has_holes:
        assert found.mask[hole].all()
        around_mm = 1.4 * radius_px * 120 / 64  # at most so much less than at the rim, which is nearest
        for values in (found.pncc, found.offset):
            assert np.abs(values - ramp(128, np.ones((128, 128), dtype=bool)))[hole].max() < 2 * around_mm
            assert (np.linalg.norm(values, axis=2)[hole & ~disc(128, radius_px)] > 0.3 * around_mm).all()
