"""Levenberg-Marquardt on manifolds: the state is any value, only its increments are vectors.

SciPy's ``least_squares`` wants one flat vector and the full Jacobian. Rotations are better updated by increments, and
with thousands of rows and seven unknowns the normal equations are several times cheaper than the Jacobian's QR. A test
holds the two together.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar, final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError

State = TypeVar("State")

MAX_ITERATIONS = 60
RELATIVE_DECREASE = 1e-10
INITIAL_DAMPING = 1e-3
LARGEST_DAMPING = 1e12


@final
@dataclass(frozen=True, eq=False)
class LocalQuadratic:
    """A cost near one state: cost + gradient . step + step . hessian . step / 2."""

    cost: float  # half the sum of (weighted, possibly robust) squared residuals
    gradient: Float64[ndarray, " p"]  # J^T W r
    hessian: Float64[ndarray, "p p"]  # J^T W J, Gauss and Newton's approximation


def quadratic_of_residuals(
    residuals: Float64[ndarray, "n d"], jacobian: Float64[ndarray, "n d p"], weights: Float64[ndarray, " n"]
) -> LocalQuadratic:
    """The local quadratic of half the weighted sum of squares of n residual vectors."""
    weighted = (jacobian * weights[:, None, None]).reshape(-1, jacobian.shape[2])
    gradient = weighted.T @ residuals.reshape(-1)
    hessian = weighted.T @ jacobian.reshape(-1, jacobian.shape[2])
    cost = float(weights @ (residuals**2).sum(axis=1)) / 2
    return LocalQuadratic(cost, gradient, hessian)


def minimise(
    start: State,
    local_quadratic: Callable[[State], LocalQuadratic],
    moved: Callable[[State, Float64[ndarray, " p"]], State],
    *,
    relative_decrease: float = RELATIVE_DECREASE,
    max_iterations: int = MAX_ITERATIONS,
) -> tuple[State, LocalQuadratic]:
    """Minimises a sum of squares from a start, until a step takes off less than ``relative_decrease`` of the cost.

    ``local_quadratic`` is the cost and its derivatives with respect to an increment, at a state, and evaluated at most
    ``max_iterations`` times; ``moved`` is the state after an increment. Returns the best state seen and its local
    quadratic.

    Raises:
        DegenerateGeometryError: The cost at the start is not finite.

    Source: Nocedal and Wright, Numerical Optimization, Section 10.3; damping scaled by the diagonal (Marquardt 1963).
    """
    state, quadratic = start, local_quadratic(start)
    if not np.isfinite(quadratic.cost):
        raise DegenerateGeometryError("expected finite points, found a cost that is not finite at the start of the fit")
    damping = INITIAL_DAMPING
    for _ in range(max_iterations):
        if damping > LARGEST_DAMPING:
            break
        step = _damped_step(quadratic, damping)
        if step is None:
            damping *= 10
            continue
        candidate = moved(state, step)
        candidate_quadratic = local_quadratic(candidate)
        if not candidate_quadratic.cost < quadratic.cost:  # also refuses NaN
            damping *= 10
            continue
        decrease = quadratic.cost - candidate_quadratic.cost
        is_done = decrease <= relative_decrease * quadratic.cost
        state, quadratic, damping = candidate, candidate_quadratic, damping / 10
        if is_done:
            break
    return state, quadratic


def _damped_step(quadratic: LocalQuadratic, damping: float) -> Float64[ndarray, " p"] | None:
    """The minimum of the damped quadratic, or None where the damped matrix is still singular."""
    diagonal = np.diagonal(quadratic.hessian)
    floor = 1e-12 * max(float(diagonal.max()), 1e-300)
    matrix = quadratic.hessian + np.diag(damping * np.maximum(diagonal, floor))
    try:
        return np.asarray(np.linalg.solve(matrix, -quadratic.gradient), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
