"""Points that cannot be those of their picture: what is refused, what is missing, and which cause is named."""

from pathlib import Path

import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.face_files.point_checks import check_points

WHERE = Path("face.pts")
SIZE_PX = (200, 400)  # height, width
POINTS = np.random.default_rng(0).uniform([250, 50], [390, 190], (68, 2))


def test_points_within_the_picture_are_all_there() -> None:
    assert check_points(POINTS, SIZE_PX, 1, WHERE).all()


def test_what_lies_outside_is_left_out_up_to_a_third() -> None:
    points = POINTS.copy()
    points[:22, 0] += 400
    assert check_points(points, SIZE_PX, 1, WHERE).tolist() == [False] * 22 + [True] * 46
    points[22, 0] += 400
    with pytest.raises(InputFileError, match=r"400 x 200 pixels, found 23 of 68 outside; was the picture resized"):
        check_points(points, SIZE_PX, 1, WHERE)


def test_a_pixel_beyond_the_border_is_within() -> None:
    points = POINTS.copy()
    points[:2] = [-0.5, 3], [400.5, 200.5]
    assert check_points(points, SIZE_PX, 1, WHERE).all()


@pytest.mark.parametrize("orientation", [1, 6])
def test_swapped_axes_are_the_cause_where_they_bring_points_back(orientation: int) -> None:
    with pytest.raises(InputFileError, match=r"are x and y swapped\?" if orientation == 1 else "orientation tag 6"):
        check_points(POINTS[:, ::-1].copy(), SIZE_PX, orientation, WHERE)


def test_missing_points_do_not_count_as_outside() -> None:
    points = POINTS.copy()
    points[:34] = np.nan
    assert check_points(points, SIZE_PX, 1, WHERE).sum() == 34
    points[34] = np.nan
    with pytest.raises(InputFileError, match="at least 34 of the 68 points of a face, found 33"):
        check_points(points, SIZE_PX, 1, WHERE)


def test_of_points_that_stand_only_where_they_are_seen_two_are_enough() -> None:
    points = POINTS[:21].copy()
    points[2:] = np.nan
    assert check_points(points, SIZE_PX, 1, WHERE).sum() == 2
    points[1:] = np.nan
    with pytest.raises(InputFileError, match="at least 2 of the 21 points of a face, found 1"):
        check_points(points, SIZE_PX, 1, WHERE)
