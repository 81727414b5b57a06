"""Intervals of figures by the percentile bootstrap: how far a figure depends on the choice of the faces.

Faces are drawn with replacement, as many as there are. Frames of one clip are not independent, so there whole clips are
drawn. A draw is stored as the number of times that each face is in it, so a figure of all draws is one matrix product.

Source: Efron and Tibshirani 1993, An Introduction to the Bootstrap, chapters 13 (percentile interval) and 8 (data that
come in groups).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64, Int
from numpy import ndarray

CONFIDENCE = 0.95
# Entries of one table of draws: bounds the memory whatever the number of frames.
LARGEST_TABLE = 4_000_000

Interval = tuple[float, float]
# From draws (how often each face is in each) to the figure of each draw; NaN where a draw has none.
Statistic = Callable[[Float64[ndarray, "r n"]], Float64[ndarray, " r"]]


@final
@dataclass(frozen=True)
class Bootstrap:
    """How intervals are drawn."""

    n_resamples: int = 1000  # 0 for no intervals
    seed: int = 0


def cluster_indices(clusters: Sequence[str]) -> Int[ndarray, " n"]:
    """Numbers from 0 for names: the clip of each face, or its own name where faces are independent."""
    return np.unique(np.asarray(clusters, dtype=np.str_), return_inverse=True)[1].astype(np.intp)


def intervals(
    statistics: Mapping[str, Statistic], clusters: Int[ndarray, " n"], bootstrap: Bootstrap
) -> dict[str, Interval | None]:
    """95 % intervals of several figures from the same draws, in which faces of one cluster (a clip) stay together.

    There is none for fewer than two clusters, without draws, or where more than half of the draws have no such figure.
    """
    n_clusters = int(clusters.max()) + 1 if len(clusters) else 0
    if n_clusters < 2 or bootstrap.n_resamples < 1:
        return dict.fromkeys(statistics)
    drawn: dict[str, list[ndarray]] = {name: [] for name in statistics}
    for draws in _draws(clusters, n_clusters, bootstrap):
        for name, statistic in statistics.items():
            drawn[name].append(statistic(draws))
    return {name: _percentiles(np.concatenate(values)) for name, values in drawn.items()}


def mean_of(values: Float64[ndarray, " n"]) -> Statistic:
    """Mean over the finite values of a draw."""
    finite = np.isfinite(values)
    summands, counted = np.where(finite, values, 0.0), finite.astype(np.float64)
    return lambda draws: _divide(draws @ summands, draws @ counted)


def median_of(errors: Float64[ndarray, " n"]) -> Statistic:
    """Median of the finite errors of a draw."""
    order = np.argsort(errors)[: int(np.isfinite(errors).sum())]
    values = errors[order]

    def median(draws: Float64[ndarray, "r n"]) -> Float64[ndarray, " r"]:
        if not len(values):
            return np.full(len(draws), np.nan)
        up_to = np.cumsum(draws[:, order], axis=1)
        total = up_to[:, -1:]
        places = [np.minimum((up_to <= half).sum(axis=1), len(values) - 1) for half in ((total - 1) // 2, total // 2)]
        return np.where(total[:, 0] > 0, (values[places[0]] + values[places[1]]) / 2, np.nan)

    return median


def mean_of_statistics(statistics: Sequence[Statistic]) -> Statistic:
    """Unweighted mean of several figures; a draw that lacks one of them has none."""
    return lambda draws: np.mean([statistic(draws) for statistic in statistics], axis=0)


def _draws(clusters: Int[ndarray, " n"], n_clusters: int, bootstrap: Bootstrap) -> Iterator[Float64[ndarray, "r n"]]:
    generator = np.random.default_rng(bootstrap.seed)
    n_at_once = max(1, LARGEST_TABLE // len(clusters))
    for start in range(0, bootstrap.n_resamples, n_at_once):
        n = min(n_at_once, bootstrap.n_resamples - start)
        counts = generator.multinomial(n_clusters, np.full(n_clusters, 1 / n_clusters), size=n)
        yield counts[:, clusters].astype(np.float64)


def _percentiles(values: Float64[ndarray, " r"]) -> Interval | None:
    known = values[np.isfinite(values)]
    if len(known) * 2 <= len(values):
        return None
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(known, [tail, 1 - tail])
    return float(low), float(high)


def _divide(numerator: Float64[ndarray, " r"], denominator: Float64[ndarray, " r"]) -> Float64[ndarray, " r"]:
    return np.divide(numerator, denominator, out=np.full(len(numerator), np.nan), where=denominator > 0)
