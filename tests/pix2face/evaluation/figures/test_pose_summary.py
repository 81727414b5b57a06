"""Means and signs by bin, computed by hand."""

import numpy as np
import pytest

from pix2face.evaluation.figures.pose_summary import PoseErrors, summarise_poses


def test_errors_are_summed_up_by_bin_of_the_true_yaw():
    errors = [
        PoseErrors(np.array([1.0, -2.0, 3.0]), 4.0),
        PoseErrors(np.array([-3.0, 4.0, 3.0]), 6.0),
        PoseErrors(np.array([0.0, 10.0, 0.0]), 11.0),
        None,
        PoseErrors(np.zeros(3), 0.0),
    ]
    poses = summarise_poses([10.0, -20.0, -70.0, 50.0, None], errors)
    assert poses is not None
    front, middle, side, everything = poses.values()
    assert (front.n_images, middle.n_images, side.n_images, everything.n_images) == (2, 0, 1, 3)
    assert front.mean_absolute_deg == pytest.approx({"pitch": 2, "yaw": 3, "roll": 3})
    assert front.bias_deg == pytest.approx({"pitch": -1, "yaw": 1, "roll": 3})
    assert (front.mean_of_angles_deg, middle.mean_of_angles_deg) == (pytest.approx(8 / 3), None)
    assert [own.mean_rotation_deg for own in (front, middle, side, everything)] == [5, None, 11, 7]
    # Both heads are taken for less turned than they are: by 2 and by 4 degrees.
    assert front.yaw_shrinkage_deg == pytest.approx(-3)
    assert side.yaw_shrinkage_deg == pytest.approx(-10)
    assert middle.mean_absolute_deg["yaw"] is None
    assert everything.bias_deg["yaw"] == pytest.approx(4)


def test_without_poses_there_is_nothing():
    assert summarise_poses([3.0], [None]) is None
    assert summarise_poses([], []) is None
