"""The learning rate of each step."""

import math
from typing import Literal

ScheduleName = Literal["paper", "cosine", "linear"]

# From 1e-3 to about 2.1e-5 in the paper.
FINAL_FRACTION = 0.021


def learning_rate(epoch: int, epochs: int, initial: float) -> float:
    """Falls by the same factor from each epoch to the next: initial * 0.021^(epoch / (epochs - 1)).

    The paper says "a fixed schedule" and its two ends; this curve through them is our reading, and it stretches to any
    number of epochs, which are counted from 0. A single epoch keeps the initial rate.

    Source: Crispell and Bazik 2017, Sec. 3.2.
    """
    return initial * FINAL_FRACTION ** (epoch / max(epochs - 1, 1))


def smooth_rate(schedule: ScheduleName, step: int, steps: int, warm_up_steps: int) -> float:
    """The rate of a step, counted from 0, as a fraction of the largest rate; always above 0.

    It rises evenly to 1 during warm-up, then falls to almost 0 at the last step, evenly or as half a wave of a cosine.
    """
    if step < warm_up_steps:
        return (step + 1) / (warm_up_steps + 1)
    gone = (step - warm_up_steps) / max(steps - warm_up_steps, 1)
    return 1 - gone if schedule == "linear" else (1 + math.cos(math.pi * gone)) / 2
