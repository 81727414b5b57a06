"""The covariance against the scatter of many estimates."""

import numpy as np
import pytest

from pix2face.fitting.least_squares.covariance import coefficient_covariance
from pix2face.fitting.least_squares.linear_system import image_system
from pix2face.fitting.prepared_model import vertex_basis
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
BASIS = vertex_basis(MODEL, np.flatnonzero(MODEL.is_face_vertex)[::40]).astype(np.float64)
N_COEFFICIENTS = MODEL.n_identity + MODEL.n_expression
SIGMA_MM = 4.0
N_DRAWS = 700


@pytest.mark.parametrize("factor", [0.1, 1.0, 10.0])
def test_noise_and_shrinkage_are_what_estimates_show(factor):
    rng = np.random.default_rng(0)
    regularisation = factor * SIGMA_MM**2
    truth = rng.standard_normal((N_DRAWS, N_COEFFICIENTS))
    noise = SIGMA_MM * rng.standard_normal((N_DRAWS, len(BASIS), 3))
    systems = [
        image_system(BASIS, BASIS @ face + own, regularisation, robust_rounds=0)
        for face, own in zip(truth, noise, strict=True)
    ]
    errors = np.stack([system.solve(regularisation) for system in systems]) - truth
    expected = coefficient_covariance(systems[0], regularisation, SIGMA_MM**2)
    found = errors.T @ errors / N_DRAWS
    np.testing.assert_allclose(np.diagonal(found), np.diagonal(expected.total), rtol=0.2)
    assert np.abs(found - expected.total).max() < 0.15 * np.diagonal(expected.total).max()

    one_face = np.stack(
        [
            image_system(BASIS, BASIS @ truth[0] + own, regularisation, robust_rounds=0).solve(regularisation)
            for own in noise
        ]
    )
    np.testing.assert_allclose(one_face.var(axis=0), np.diagonal(expected.noise), rtol=0.2)


def test_with_lambda_as_variance_it_is_the_posterior():
    system = image_system(BASIS, BASIS @ np.ones(N_COEFFICIENTS), 9.0, robust_rounds=0)
    posterior = np.linalg.inv(system.normal / 9.0 + np.eye(N_COEFFICIENTS))
    np.testing.assert_allclose(coefficient_covariance(system, 9.0).total, posterior, atol=1e-10)


def test_points_that_were_measured_are_known_better():
    """Vertices of one half of the face are found: the other half is known less well."""
    x = MODEL.mean[:, 0]
    seen, hidden = (np.flatnonzero(MODEL.is_face_vertex & side) for side in (x > 20, x < -20))
    basis = vertex_basis(MODEL, seen[::10]).astype(np.float64)
    system = image_system(basis, np.zeros((len(basis), 3)), 20.0, robust_rounds=0)
    covariance = coefficient_covariance(system, 20.0)
    spread = [
        np.trace(covariance.of_points(vertex_basis(MODEL, half[::10])), axis1=1, axis2=2).mean()
        for half in (seen, hidden)
    ]
    assert spread[0] < 0.8 * spread[1]
