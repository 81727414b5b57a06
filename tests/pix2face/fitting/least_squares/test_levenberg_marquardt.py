import numpy as np
import pytest
from scipy.optimize import least_squares

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.least_squares.levenberg_marquardt import LocalQuadratic, minimise, quadratic_of_residuals


def rosenbrock(x):
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def rosenbrock_jacobian(x):
    return np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def quadratic(x, target):
    return quadratic_of_residuals((rosenbrock(x) - target)[:, None], rosenbrock_jacobian(x)[:, None, :], np.ones(2))


@pytest.mark.parametrize("start", [(-1.2, 1.0), (3.0, -4.0), (0.0, 0.0)])
def test_finds_the_minimum_that_scipy_finds(start):
    # A third residual keeps the minimum above zero, where Gauss-Newton alone would be off.
    def residuals(x):
        return np.append(rosenbrock(x), 0.5 * (x[0] + x[1]))

    def jacobian(x):
        return np.vstack([rosenbrock_jacobian(x), [0.5, 0.5]])

    found, _ = minimise(
        np.array(start),
        lambda x: quadratic_of_residuals(residuals(x)[:, None], jacobian(x)[:, None, :], np.ones(3)),
        np.add,
        relative_decrease=1e-14,
        max_iterations=300,
    )
    expected = least_squares(residuals, start, jacobian, method="lm", xtol=1e-14, ftol=1e-14).x
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_weights_count_as_repetitions():
    rng = np.random.default_rng(0)
    residuals, jacobian = rng.normal(size=(4, 2)), rng.normal(size=(4, 2, 3))
    weighted = quadratic_of_residuals(residuals, jacobian, np.array([1.0, 3.0, 0.0, 2.0]))
    again = [0, 1, 1, 1, 3, 3]
    repeated = quadratic_of_residuals(residuals[again], jacobian[again], np.ones(6))
    assert weighted.cost == pytest.approx(repeated.cost)
    np.testing.assert_allclose(weighted.gradient, repeated.gradient)
    np.testing.assert_allclose(weighted.hessian, repeated.hessian)


def test_unknown_without_influence_stays():
    def flat(x):
        return LocalQuadratic(float((x[0] - 1) ** 2) / 2, np.array([x[0] - 1, 0.0]), np.diag([1.0, 0.0]))

    found, end = minimise(np.array([5.0, 7.0]), flat, np.add)
    np.testing.assert_allclose(found, [1, 7])
    assert end.cost < 1e-12


def test_never_accepts_a_step_into_the_undefined():
    def half_line(x):  # log x: the cost is NaN left of 0
        with np.errstate(invalid="ignore"):
            residual = np.log(x) + 3
        return LocalQuadratic(float(residual[0] ** 2) / 2, residual / x, np.diag(1 / x**2))

    found, _ = minimise(np.array([5.0]), half_line, np.add)
    np.testing.assert_allclose(found, np.exp(-3), rtol=1e-6)


def test_refuses_a_start_that_is_not_finite():
    with pytest.raises(DegenerateGeometryError, match="not finite"):
        minimise(np.array([np.nan]), lambda x: LocalQuadratic(float(x[0]), x, np.eye(1)), np.add)
