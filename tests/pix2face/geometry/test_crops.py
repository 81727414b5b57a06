"""Boxes and crops: points, pictures and cameras must tell the same story."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.camera import HeadPose, Pinhole, pinhole_camera, rotation_of_pose
from pix2face.geometry.crops import FaceBox, crop_camera, crop_image, image_centre_in_crop, pixels_in_image, square_crop

BOX = FaceBox(100, 80, 180, 200)


def test_the_box_is_tight_and_leaves_out_what_is_not_finite() -> None:
    points = np.array([[3.0, 4], [10, 2], [np.nan, 0], [5, np.inf]])
    box = FaceBox.around(points)
    assert (box.left, box.top, box.right, box.bottom) == (3, 2, 10, 4)
    assert box.longer_side == 7


@pytest.mark.parametrize("points", [np.zeros((0, 2)), np.full((3, 2), np.nan), np.ones((5, 2))])
def test_a_box_without_extent_is_an_error(points: np.ndarray) -> None:
    with pytest.raises(DegenerateGeometryError, match="two different points"):
        FaceBox.around(points)


@given(
    st.floats(1, 2),
    st.integers(16, 300),
    st.floats(-0.25, 0.25),
    st.floats(-0.4, 0.4),
    st.booleans(),
    st.integers(0, 9),
)
def test_points_go_there_and_back(
    scale: float, size: int, shift: float, rotation: float, mirror: bool, seed: int
) -> None:
    crop = square_crop(BOX, scale, size, shift=(shift, -shift), rotation=rotation, mirror=mirror)
    points = np.random.default_rng(seed).uniform(0, 400, (5, 2))
    np.testing.assert_allclose(crop.to_image(crop.to_crop(points)), points, atol=1e-6)


def test_the_crop_is_centred_and_as_large_as_said() -> None:
    crop = square_crop(BOX, 1.5, 60)
    np.testing.assert_allclose(crop.to_image(np.array([30.0, 30.0])), BOX.centre)
    corners = crop.to_image(np.array([[0.0, 0.0], [60.0, 60.0]]))
    np.testing.assert_allclose(corners[1] - corners[0], [180, 180])  # 1.5 * 120


@pytest.mark.parametrize("size", [32, 64, 200])
def test_a_blob_lands_where_its_point_lands(size: int) -> None:
    """The half pixel: centres of mass in picture and crop agree with the map of points."""
    image = np.zeros((300, 300, 3), np.uint8)
    cv2.circle(image, (150, 130), 12, (255, 255, 255), -1)
    crop = square_crop(BOX, 1.5, size, rotation=0.2)
    for picture, where in ((image, np.array([150.5, 130.5])), (crop_image(image, crop), None)):
        weights = picture[..., 0].astype(float)
        rows, columns = np.indices(weights.shape)
        centre = np.array([(weights * (columns + 0.5)).sum(), (weights * (rows + 0.5)).sum()]) / weights.sum()
        expected = crop.to_crop(np.array([150.5, 130.5])) if where is None else where
        np.testing.assert_allclose(centre, expected, atol=0.06)


def test_the_identity_crop_changes_nothing() -> None:
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    crop = square_crop(FaceBox(0, 0, 64, 64), 1.0, 64)
    np.testing.assert_array_equal(crop_image(image, crop), image)
    np.testing.assert_array_equal(crop_image(image, crop, nearest=True), image)


def test_beyond_the_border_is_black() -> None:
    image = np.full((50, 50, 3), 200, np.uint8)
    crop = square_crop(FaceBox(-100, -100, -50, -50), 1.0, 32)
    assert not crop_image(image, crop).any()


def test_the_camera_of_a_crop_sees_what_the_crop_shows() -> None:
    pinhole = Pinhole(900.0, np.array([150.0, 150.0]), rotation_of_pose(HeadPose(5, 20, 10)), np.array([0.0, 0, 900]))
    camera = pinhole_camera(pinhole)
    crop = square_crop(BOX, 1.4, 128, rotation=0.3, shift=(0.1, 0.0))
    points = np.random.default_rng(1).normal(0, 60, (20, 3))
    np.testing.assert_allclose(crop_camera(camera, crop).project(points), crop.to_crop(camera.project(points)))


@pytest.mark.parametrize("side", [1e5, 1e7, 1e9])
def test_a_huge_box_costs_no_memory(side: float) -> None:
    image = np.full((60, 80, 3), 200, np.uint8)
    crop = crop_image(image, square_crop(FaceBox(-side, -side, side, side), 1.4, 32))
    assert crop.any(axis=2).sum() <= 4  # the whole picture is less than a pixel


def test_pixels_in_the_image() -> None:
    """A crop of twice the side about the corner of an image of 40 x 60 pixels: a quarter of it shows the image."""
    crop = square_crop(FaceBox(-10, -10, 10, 10), 2.0, 32)
    inside = pixels_in_image(crop, (40, 60))
    assert inside is not None
    expected = np.zeros((32, 32), dtype=bool)
    expected[16:, 16:] = True
    np.testing.assert_array_equal(inside, expected)
    assert pixels_in_image(square_crop(FaceBox(10, 10, 30, 30), 1.0, 32), (40, 60)) is None
    beside = pixels_in_image(square_crop(FaceBox(100, 100, 120, 120), 1.0, 32), (40, 60))
    assert beside is not None
    assert not beside.any()


def test_a_much_coarser_crop_of_a_picture_that_is_not_square_stays_in_place() -> None:
    """Blocks are averaged first; neither side of the picture is a multiple of their size."""
    ramp = np.stack(np.meshgrid(np.arange(181) + 0.5, np.arange(75) + 0.5), axis=-1).astype(np.float32)
    crop = square_crop(FaceBox(20, 10, 80, 60), 1.0, 14)
    centres = np.stack(np.meshgrid(np.arange(14) + 0.5, np.arange(14) + 0.5), axis=-1)
    np.testing.assert_allclose(crop_image(ramp, crop), crop.to_image(centres), atol=0.15)


def test_the_centre_of_a_wide_image_lies_where_its_width_says() -> None:
    crop = square_crop(FaceBox(10, 20, 50, 60), 1.0, 40)
    np.testing.assert_allclose(image_centre_in_crop(crop, (100, 300)), [150 - 10, 50 - 20], atol=1e-9)


def test_positive_rotation_turns_what_is_seen_anticlockwise() -> None:
    crop = square_crop(FaceBox(0, 0, 100, 100), 1.0, 100, rotation=np.deg2rad(30))
    x, y = crop.to_crop(np.array([90.0, 50.0])) - 50  # right of the centre
    assert x == pytest.approx(40 * np.cos(np.deg2rad(30)))
    assert y == pytest.approx(-40 * np.sin(np.deg2rad(30)))  # goes up, and y points down


def test_the_turn_of_a_box_adds_to_the_rotation_of_its_crop() -> None:
    told = square_crop(FaceBox(0, 0, 100, 60, turn_deg=25), 1.4, 100, rotation=np.deg2rad(5), shift=(0.1, 0))
    turned = square_crop(FaceBox(0, 0, 100, 60), 1.4, 100, rotation=np.deg2rad(30), shift=(0.1, 0))
    np.testing.assert_allclose(told.image_from_crop, turned.image_from_crop)


def test_shift_moves_the_crop_right_and_then_down() -> None:
    crop = square_crop(FaceBox(0, 0, 100, 50), 1.0, 10, shift=(0.2, -0.1))
    np.testing.assert_allclose(crop.to_image(np.array([5.0, 5.0])), [50 + 20, 25 - 10], atol=1e-9)


def test_pixels_right_of_a_wide_image_are_outside_and_those_within_it_are_not() -> None:
    whole = square_crop(FaceBox(200, 0, 300, 100), 1.0, 10)
    assert pixels_in_image(whole, (100, 300)) is None
    inside = pixels_in_image(square_crop(FaceBox(250, 0, 350, 100), 1.0, 10), (100, 300))
    assert inside is not None
    np.testing.assert_array_equal(inside, np.tile(np.arange(10) < 5, (10, 1)))


@pytest.mark.parametrize(("longer_side", "finest"), [(30.0, 64), (300.0, 390)])
def test_a_crop_of_another_size_shows_the_same_part(longer_side: float, finest: int) -> None:
    crop = square_crop(FaceBox(10, 20, 10 + longer_side, 40), 1.3, 64, rotation=0.3, mirror=True)
    assert crop.finest_size_px == finest
    other = crop.with_size(finest)
    np.testing.assert_allclose(
        other.to_image(np.array([[0, 0], [finest, 5.0]])), crop.to_image(np.array([[0, 0], [64, 5 * 64 / finest]]))
    )
