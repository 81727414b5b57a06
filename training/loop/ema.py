"""A running mean of the weights: less noisy than those of any one step, and better on faces not seen."""

import copy
from typing import final

import torch
from torch import nn

# Averaging every fourth step with the fourth power of the decay is as smooth, at a quarter of the time.
STEPS_BETWEEN = 4


@final
class RunningMean:
    """Keeps a second network whose weights follow the first one's, and its norms' statistics, too.

    Args:
        network: The one that learns.
        decay: How much of the mean is left after a step; while steps are fewer than 1 / (1 - decay) it is less, so that
            the first weights do not linger.
    """

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.network = copy.deepcopy(network).eval().requires_grad_(False)
        self._decay = decay

    @torch.no_grad()
    def follow(self, network: nn.Module, step: int) -> None:
        """Takes in the weights after a step.

        Args:
            network: The one that learns.
            step: Steps done, from 1.
        """
        if step % STEPS_BETWEEN:
            return
        decay = min(self._decay, (1 + step) / (10 + step)) ** STEPS_BETWEEN
        pairs = zip(self.network.state_dict().values(), network.state_dict().values(), strict=True)
        means, presents = [], []
        for mean, present in pairs:
            if mean.is_floating_point():
                means.append(mean)
                presents.append(present)
            else:
                mean.copy_(present)
        torch._foreach_lerp_(means, presents, 1 - decay)
