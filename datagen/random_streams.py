"""Random streams that depend only on a seed and a sample's name, and drawn numbers as they are stored."""

import hashlib
from collections.abc import Iterable, Mapping

import numpy as np

Triple = tuple[float, float, float]


def generator_for(seed: int, sample_id: str) -> np.random.Generator:
    """The random stream of one sample; it does not depend on the order of work."""
    name = int.from_bytes(hashlib.sha256(sample_id.encode()).digest()[:8], "little")
    return np.random.default_rng([seed, name])


def weighted_choice(rng: np.random.Generator, weights: Mapping[str, float]) -> str:
    """Draws one of the keys; the weights need not sum to 1."""
    shares = np.array(list(weights.values()))
    return str(rng.choice(list(weights), p=shares / shares.sum()))


def rounded(value: float, digits: int = 3) -> float:
    """A drawn number with few digits, which is short in JSON."""
    return round(float(value), digits)


def triple(values: Iterable[float], digits: int = 4) -> Triple:
    """Three drawn numbers with few digits: a colour or a place."""
    x, y, z = (rounded(value, digits) for value in values)
    return x, y, z
