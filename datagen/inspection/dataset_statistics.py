"""What a set of shards holds, counted: pose, size, coefficients, landmarks, attributes, and what of it is rare."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from pix2face.geometry.landmarks import IBUG68_PARTS, N_IBUG68

# Of the samples: a bin with fewer is rare.
RARE_SHARE = 0.01


@final
@dataclass(frozen=True, eq=False)
class Histogram:
    """How often a quantity falls into each of some ranges.

    Attributes:
        name: Of the quantity.
        unit: Of the edges.
        edges: Of the ranges; infinite at the end of one that is open. Values beyond the outer ones count with the
            outer ranges.
        counts: Samples of each range, one fewer than edges.
        n_samples: Of the set; those where the quantity is unknown are in no range.
    """

    name: str
    unit: str
    edges: Float64[ndarray, " e"]
    counts: Int64[ndarray, " b"]
    n_samples: int

    def range_name(self, first: int, last: int) -> str:
        """In words, from the lower edge of one range to the upper edge of another."""
        low, high = self.edges[first], self.edges[last + 1]
        return f"{low:g} {self.unit} and more" if np.isinf(high) else f"{low:g} to {high:g} {self.unit}"

    def rare(self) -> list[str]:
        """Ranges with less than 1 % of the samples each, neighbours together."""
        is_rare = np.append(self.counts < RARE_SHARE * self.n_samples, False)
        found, first = [], None
        for i, rare in enumerate(is_rare):
            if rare and first is None:
                first = i
            elif not rare and first is not None:
                n = int(self.counts[first:i].sum())
                found.append(f"{self.name} {self.range_name(first, i - 1)}: {_share(n, self.n_samples)}")
                first = None
        return found


@final
@dataclass(frozen=True, eq=False)
class CoefficientStatistics:
    """The coefficients of one basis, component by component.

    Attributes:
        name: ``identity`` or ``expression``.
        rms: Root mean square, standard deviations: 1 where faces are drawn from the model.
        far_share: Share of samples beyond 3 standard deviations.
        largest: Largest magnitude of all.
    """

    name: str
    rms: Float64[ndarray, " k"]
    far_share: Float64[ndarray, " k"]
    largest: float


@final
@dataclass(frozen=True, eq=False)
class DatasetStatistics:
    """What a set of shards holds.

    Attributes:
        n_samples: In all shards.
        n_shards: Their number.
        picture_sizes: Samples of each size, "width x height".
        histograms: Pose and face size.
        coefficients: Of identity and expression.
        visible_share: Of each landmark, the share of samples with landmarks where it is seen; empty without landmarks.
        kinds: For each text attribute how often it has each value; empty where there are too many to be kinds.
        numbers: For each numeric attribute its smallest, mean and largest value.
    """

    n_samples: int
    n_shards: int
    picture_sizes: Mapping[str, int]
    histograms: tuple[Histogram, ...]
    coefficients: tuple[CoefficientStatistics, ...]
    visible_share: Float64[ndarray, " m"]
    kinds: Mapping[str, Mapping[str, int]]
    numbers: Mapping[str, tuple[float, float, float]]

    def visible_parts(self) -> dict[str, float]:
        """Share of landmarks seen in each part of the face; empty unless they are the 68 of iBUG."""
        if len(self.visible_share) != N_IBUG68:
            return {}
        return {name: float(self.visible_share[list(points)].mean()) for name, points in IBUG68_PARTS.items()}

    def rare(self) -> list[str]:
        """What less than 1 % of the samples have, in words; neighbouring ranges are summed."""
        found = [line for histogram in self.histograms for line in histogram.rare()]
        hidden = [i for i, share in enumerate(self.visible_share) if share < RARE_SHARE]
        if hidden:
            found.append(f"landmarks seen in less than 1 %: {', '.join(map(str, hidden))}")
        for name, kinds in self.kinds.items():
            rare = [(value, n) for value, n in kinds.items() if n < RARE_SHARE * self.n_samples]
            found += [f"{name} {value!r}: {_share(n, self.n_samples)}" for value, n in rare]
        return found

    def as_json(self) -> dict[str, Any]:
        """Plain values, to be written as JSON."""
        return {
            "n_samples": self.n_samples,
            "n_shards": self.n_shards,
            "picture_sizes": dict(self.picture_sizes),
            "histograms": {
                histogram.name: {
                    "unit": histogram.unit,
                    "edges": [edge if np.isfinite(edge) else None for edge in histogram.edges.tolist()],
                    "counts": histogram.counts.tolist(),
                }
                for histogram in self.histograms
            },
            "coefficients": {
                found.name: {
                    "rms": found.rms.round(4).tolist(),
                    "share_beyond_3_sd": found.far_share.round(6).tolist(),
                    "largest": found.largest,
                }
                for found in self.coefficients
            },
            "landmarks_visible_share": self.visible_share.round(4).tolist(),
            "attribute_kinds": {name: dict(kinds) for name, kinds in self.kinds.items()},
            "attribute_numbers": {
                name: dict(zip(("smallest", "mean", "largest"), values, strict=True))
                for name, values in self.numbers.items()
            },
            "rare": self.rare(),
        }


def _share(n: int, total: int) -> str:
    return f"{n} of {total} ({100 * n / total:.2f} %)"
