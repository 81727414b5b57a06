"""Statistics of a set of samples: pose, face size, coefficients, landmarks, attributes, and what of it is rare.

The same statistics describe shards, tables of coefficients and folders of coefficient files.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from pix2face.geometry.landmarks import IBUG68_PARTS, N_IBUG68

# What fewer samples than this share have is rare.
RARE_SHARE = 0.01
# So many rare values of an attribute are named; the others are summed.
N_RARE_SHOWN = 12
_ANGLES = (-180, *range(-90, 91, 15), 180)
_SIZES = (0, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, np.inf)
_DISTANCES = (0, 400, 600, 1000, 1600, 2500, 4500, np.inf)
# Unit and edges of the ranges of each quantity.
QUANTITIES = {
    "pitch": ("°", _ANGLES),
    "yaw": ("°", _ANGLES),
    "roll": ("°", _ANGLES),
    "face size": ("px", _SIZES),
    "distance": ("mm", _DISTANCES),
}


@final
@dataclass(frozen=True, eq=False)
class Histogram:
    """How often a quantity falls into each of several ranges; values beyond the edges count with the outer ranges."""

    name: str  # of the quantity
    unit: str  # of the edges
    edges: Float64[ndarray, " e"]  # of the ranges; infinite at the end of an open range
    counts: Int64[ndarray, " b"]  # number of samples in each range
    n_samples: int  # size of the whole set; samples whose quantity is unknown are in no range

    @staticmethod
    def of(name: str, values: Float64[ndarray, " n"], n_samples: int) -> "Histogram":
        """Counts values of one of ``QUANTITIES``."""
        unit, edges = QUANTITIES[name]
        places = np.searchsorted(edges, values, side="right") - 1
        counts = np.bincount(np.clip(places, 0, len(edges) - 2), minlength=len(edges) - 1)
        return Histogram(name, unit, np.array(edges, dtype=np.float64), counts, n_samples)

    def range_name(self, first: int, last: int) -> str:
        """Names the range from the lower edge of one bin to the upper edge of another."""
        low, high = self.edges[first], self.edges[last + 1]
        return f"{low:g} {self.unit} and more" if np.isinf(high) else f"{low:g} to {high:g} {self.unit}"

    def middle(self) -> str:
        """Names the ranges in which the middle 90 % of the known values lie, as one range."""
        up_to = np.cumsum(self.counts) / max(int(self.counts.sum()), 1)
        first, last = np.searchsorted(up_to, [0.05, 0.95], side="right")
        return self.range_name(int(first), min(int(last), len(self.counts) - 1))

    def rare(self) -> list[str]:
        """Names the ranges with less than 1 % of the samples; neighbouring ranges are summed."""
        found, first = [], None
        for i, is_rare in enumerate([*(self.counts < RARE_SHARE * self.n_samples), False]):
            if is_rare and first is None:
                first = i
            elif not is_rare and first is not None:
                n = int(self.counts[first:i].sum())
                found.append(f"{self.name} {self.range_name(first, i - 1)}: {_share(n, self.n_samples)}")
                first = None
        return found


@final
@dataclass(frozen=True, eq=False)
class CoefficientStatistics:
    """The coefficients of one basis, component by component."""

    name: str  # `identity` or `expression`
    rms: Float64[ndarray, " k"]  # root mean square in standard deviations: 1 where faces are drawn from the model
    far_share: Float64[ndarray, " k"]  # share of samples beyond 3 standard deviations
    largest: float  # largest magnitude of all components


@final
@dataclass(frozen=True, eq=False)
class DatasetStatistics:
    """What a set of samples holds."""

    n_samples: int
    n_shards: int  # 0 for a table or a folder of coefficient files
    picture_sizes: Mapping[str, int]  # number of samples of each size ("width x height"), most frequent first
    histograms: tuple[Histogram, ...]  # pose, face size and distance, as far as they are known
    coefficients: tuple[CoefficientStatistics, ...]  # identity and expression
    # for each landmark, the share of the samples with landmarks in which it is visible; empty without landmarks
    visible_share: Float64[ndarray, " m"]
    # for each text attribute the number of samples of each value, most frequent first; empty where there are too many
    # values to be kinds
    kinds: Mapping[str, Mapping[str, int]]
    numbers: Mapping[str, tuple[float, float, float]]  # smallest, mean and largest value of each numeric attribute
    doubtful: tuple[tuple[str, str], ...]  # samples of photographs, and why their ground truth cannot be true

    def visible_parts(self) -> dict[str, float]:
        """Share of visible landmarks in each part of the face; empty unless they are the 68 of iBUG."""
        if len(self.visible_share) != N_IBUG68:
            return {}
        return {name: float(self.visible_share[list(points)].mean()) for name, points in IBUG68_PARTS.items()}

    def rare_ranges(self) -> list[str]:
        """Says which ranges of pose, size and distance, and which landmarks, less than 1 % of the samples have."""
        found = [line for histogram in self.histograms for line in histogram.rare()]
        hidden = [i for i, share in enumerate(self.visible_share) if share < RARE_SHARE]
        if hidden:
            found.append(f"landmarks seen in less than 1 %: {', '.join(map(str, hidden))}")
        return found

    def rare_kinds(self, name: str) -> list[tuple[str, int]]:
        """The values of a text attribute that less than 1 % of the samples have, and how many have each."""
        return [(value, n) for value, n in self.kinds[name].items() if n < RARE_SHARE * self.n_samples]

    def rare(self) -> list[str]:
        """Says what less than 1 % of the samples have; neighbouring ranges are summed."""
        found = self.rare_ranges()
        for name in self.kinds:
            rare = self.rare_kinds(name)
            found += [f"{name} {value!r}: {_share(n, self.n_samples)}" for value, n in rare[:N_RARE_SHOWN]]
            if others := [n for _, n in rare[N_RARE_SHOWN:]]:
                found.append(f"{name}, {len(others)} more values: {_share(sum(others), self.n_samples)}")
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
            "doubtful": [{"sample_id": sample_id, "doubt": doubt} for sample_id, doubt in self.doubtful],
        }


def _share(n: int, total: int) -> str:
    return f"{n} of {total} ({100 * n / total:.2f} %)"
