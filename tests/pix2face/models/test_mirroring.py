from dataclasses import replace

import numpy as np
import pytest

from pix2face.errors import UsageError
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.mirroring import mirror_obstacle, mirrored_coefficients, mirrored_points
from pix2face.models.morphable_model import builtin_model


def test_the_builtin_model_can_be_mirrored():
    assert mirror_obstacle(builtin_model()) is None


def test_a_model_without_a_table_of_twins_cannot_be_mirrored():
    assert "mirror images of each other" in str(mirror_obstacle(replace(builtin_model(), symmetry=None)))


def test_an_asymmetric_mean_is_refused_and_the_asymmetry_named():
    model = builtin_model()
    mean = model.mean.copy()
    mean[np.argmax(mean[:, 0]), 1] += 0.5
    obstacle = str(mirror_obstacle(replace(model, mean=mean)))
    assert "0.50 mm" in obstacle
    assert "symmetric" in obstacle


def test_a_wrong_table_of_twins_is_refused():
    model = builtin_model()
    assert model.symmetry is not None
    assert mirror_obstacle(replace(model, symmetry=np.roll(model.symmetry, 1))) is not None


def test_landmarks_that_lie_on_one_side_are_refused():
    model = builtin_model()
    moved = model.landmarks[IBUG68].copy()
    moved[36] = moved[45]
    assert "landmarks" in str(mirror_obstacle(replace(model, landmarks={IBUG68: moved})))


def test_mirroring_changes_the_sign_of_x_alone():
    points = np.float32([[1, 2, 3]])
    np.testing.assert_array_equal(mirrored_points(points), np.float32([[-1, 2, 3]]))
    assert mirrored_points(points).dtype == np.float32


def test_mirrored_coefficients_give_the_mirrored_face():
    model = builtin_model()
    mirror = mirrored_coefficients(model)
    assert mirror.largest_error_mm < 0.5
    rng = np.random.default_rng(0)
    identity, expression = rng.normal(size=(1, model.n_identity)), rng.normal(size=(1, model.n_expression))
    twin = model.vertices(identity @ mirror.identity, expression @ mirror.expression)[0]
    assert model.symmetry is not None
    expected = mirrored_points(model.vertices(identity, expression)[0])[model.symmetry]
    assert np.linalg.norm(twin - expected, axis=1).max() < 3 * mirror.largest_error_mm
    back = identity @ mirror.identity @ mirror.identity
    np.testing.assert_allclose(back, identity, atol=1e-6)


def test_coefficients_of_a_model_without_mirror_image_are_refused():
    with pytest.raises(UsageError, match="mirror images of each other"):
        mirrored_coefficients(replace(builtin_model(), symmetry=None))
