"""The built-in model follows landmarks of another model: the figures of scripts/measure_retarget.py hold."""

import numpy as np
import pytest

from pix2face.fitting.from_landmarks import LANDMARK_REGULARISATION, LandmarkModel
from pix2face.morphable_model import builtin_model
from scripts.measure_retarget import fold_of_landmark, measure, summarise


@pytest.fixture(scope="module")
def figures(shared_dir):
    folder = shared_dir / "data" / "aflw2000_3d" / "dev"
    model = LandmarkModel.of(builtin_model())
    return summarise(measure(folder, model, regularisation=LANDMARK_REGULARISATION, with_depth=True))


def test_all_files_are_measured(figures):
    assert {name: row.faces for name, row in figures.items()} == {"to 30": 265, "to 60": 69, "above": 66, "all": 400}


@pytest.mark.parametrize("yaw", ["to 30", "to 60", "above", "all"])
def test_fits_beat_the_mean_face(figures, yaw):
    row = figures[yaw]
    assert row.fitted <= 0.7 * row.mean_face, row
    assert row.fitted_left_out <= 0.85 * row.mean_face_left_out, row
    assert row.fitted_left_out <= 2.0, row


def test_every_face_stays_plausible(figures):
    assert figures["all"].largest_rms <= 1.5


def test_every_landmark_is_left_out_once():
    folds = fold_of_landmark()
    assert folds.shape == (68,)
    assert sorted(np.unique(folds)) == [0, 1, 2, 3, 4]
