"""Randomness that depends on nothing but a seed and the name of a sample, so that the order of work does not matter."""

import hashlib

import numpy as np


def generator_for(seed: int, sample_id: str) -> np.random.Generator:
    """The random stream of one sample."""
    name = int.from_bytes(hashlib.sha256(sample_id.encode()).digest()[:8], "little")
    return np.random.default_rng([seed, name])
