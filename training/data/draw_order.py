"""Which sample each draw of a training takes; draws are numbered from 0, without end."""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import final

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from training.data.shard_index import SampleSet

# First word of the seeds of the two independent random streams.
ORDER_STREAM, JITTER_STREAM = 0, 1


@final
class DrawOrder:
    """The order in which the samples of some sets are taken.

    Within a set every sample is taken once before any is taken again, in a new order in each pass. Between sets draws
    alternate as evenly as their weights allow: of the first n draws, for any n, a set has its share to within one draw
    (for each set before it).
    """

    def __init__(self, sets: Sequence[SampleSet], seed: int) -> None:
        self._sets = sets
        self._seed = seed
        weights = [Fraction(found.weight) for found in sets]
        # The share of a set among itself and those that come after it.
        self._shares = [weight / sum(weights[number:]) for number, weight in enumerate(weights)]
        self._passes: list[tuple[int, Int64[ndarray, " n"]] | None] = [None] * len(sets)

    def sample_of(self, draw: int) -> int:
        """The number of the sample that a draw takes."""
        number = 0
        while number + 1 < len(self._sets):
            before, with_this = (_drawn(count, self._shares[number]) for count in (draw, draw + 1))
            if with_this > before:
                draw = before
                break
            draw -= before
            number += 1
        samples = self._sets[number].samples
        turn, place = divmod(draw, len(samples))
        return int(samples[self._pass(number, turn)[place]])

    def _pass(self, number: int, turn: int) -> Int64[ndarray, " n"]:
        """The order of a pass over a set; only the last one is kept."""
        known = self._passes[number]
        if known is None or known[0] != turn:
            seed = [ORDER_STREAM, self._seed, turn, *([number] if number else [])]
            known = turn, np.random.default_rng(seed).permutation(len(self._sets[number].samples))
            self._passes[number] = known
        return known[1]


def draws_of_batches(
    first_draw: int, n_batches: int, batch_size: int, rank: int = 0, n_ranks: int = 1
) -> Iterator[list[int]]:
    """The part of one machine in each of some batches of consecutive draws, from a draw of the whole training on.

    Args:
        first_draw: Of the first batch.
        n_batches: Number of batches.
        batch_size: Draws of a batch, over all machines.
        rank: Number of this machine, from 0.
        n_ranks: Number of machines, which divides the batch.
    """
    own = batch_size // n_ranks
    for batch in range(n_batches):
        first = first_draw + batch * batch_size + rank * own
        yield list(range(first, first + own))


def _drawn(n: int, share: Fraction) -> int:
    """The number of the first n draws that go to a set with this share: their product, rounded to the nearest."""
    return int((2 * n * share.numerator + share.denominator) // (2 * share.denominator))
