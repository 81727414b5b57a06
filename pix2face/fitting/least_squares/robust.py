"""Least squares that gross errors cannot pull away: solve, weigh by the residuals, solve again.

A network's outliers are a few percent of its pixels, tens of millimetres off. Huber's loss limits their pull and leads
to the right neighbourhood from a plain solution; there a redescending loss takes what is left of it away.
"""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

State = TypeVar("State")

# 95 % efficiency under normal noise; the factor makes the median of absolute residuals a standard deviation.
HUBER_THRESHOLD = 1.345
SIGMA_OF_MEDIAN = 1.4826
HUBER_ROUNDS = 4
# Rounds in which weights fall as the square of the distance. They end when no weight moves by more than this.
REDESCENDING_ROUNDS = 8
WEIGHTS_HAVE_SETTLED = 0.02


def reweighted(
    start: State,
    distances: Callable[[State], Float64[ndarray, " n"]],
    solve: Callable[[State, Float64[ndarray, " n"]], State],
    given_weights: Float64[ndarray, " n"],
) -> State:
    """Iteratively reweighted least squares with a threshold that follows the median residual.

    It begins with the solution for the given weights, which the weights of the loss are multiplied by. ``distances``
    are the lengths of the residuals; ``solve`` minimises the weighted sum of squares, or comes nearer to doing so.

    Source: Holland and Welsch 1977, Robust regression using iteratively reweighted least-squares.
    """
    state, before = start, np.ones(len(given_weights))
    for index in range(HUBER_ROUNDS + REDESCENDING_ROUNDS):
        found = distances(state)
        threshold = huber_threshold(found)
        if not threshold > 0:
            break
        weights = huber_weights(found, threshold)
        if index >= HUBER_ROUNDS:
            weights = weights**2
        if np.abs(weights - before).max(initial=0) < WEIGHTS_HAVE_SETTLED:
            if index >= HUBER_ROUNDS:
                break
            continue
        state, before = solve(state, weights * given_weights), weights
    return state


def lengths(vectors: Float[ndarray, "n d"]) -> Float[ndarray, " n"]:
    """Euclidean lengths of the rows. `numpy.linalg.norm` takes twice as long for short vectors."""
    return np.asarray(np.sqrt(np.einsum("nd,nd->n", vectors, vectors)))


def huber_threshold(distances: Float64[ndarray, " n"]) -> float:
    """1.345 standard deviations, which the median tells."""
    return HUBER_THRESHOLD * SIGMA_OF_MEDIAN * float(np.median(distances))


def huber_weights(distances: Float64[ndarray, " n"], threshold: float) -> Float64[ndarray, " n"]:
    """Weights that turn squares into Huber's loss: 1 up to the threshold, falling as 1 / distance beyond."""
    return np.asarray(threshold / np.maximum(distances, max(threshold, 1e-300)), dtype=np.float64)
