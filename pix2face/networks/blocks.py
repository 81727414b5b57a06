"""Blocks of residual networks: convolutions with batch norm, added to their input."""

from typing import final

import torch
from torch import Tensor, nn
from torch.nn import functional

from pix2face.networks.dimensions import FARTHEST


@final
class ResidualBlock(nn.Module):
    """Convolutions with batch norm, added to their input.

    Args:
        before: Filters of the input.
        after: Filters of the output.
        convolutions: 1 or 2, of 3 x 3.
        halves: Whether height and width are halved; if not, ``before`` and ``after`` are the same.
        has_bounded_norms: Whether norms are bounded: where features only go round at the innermost size, and grow.
    """

    def __init__(
        self, before: int, after: int, convolutions: int, *, halves: bool = False, has_bounded_norms: bool = False
    ) -> None:
        super().__init__()
        new_norm = BoundedBatchNorm if has_bounded_norms else nn.BatchNorm2d
        stride = 2 if halves else 1
        self.first = nn.Conv2d(before, after, kernel_size=3, stride=stride, padding=1, bias=False)
        self.first_norm = new_norm(after)
        self.second = nn.Conv2d(after, after, kernel_size=3, padding=1, bias=False) if convolutions > 1 else None
        self.second_norm = new_norm(after) if convolutions > 1 else None
        self.shortcut = nn.Conv2d(before, after, kernel_size=1, bias=False) if halves else None

    def forward(self, features: Tensor) -> Tensor:
        """Returns the features, changed."""
        change = self.first_norm(self.first(features))
        if self.second is not None and self.second_norm is not None:
            change = self.second_norm(self.second(functional.relu(change, inplace=True)))
        if self.shortcut is not None:
            features = self.shortcut(functional.avg_pool2d(features, 2))
        return functional.relu(change + features, inplace=True)


@final
class BoundedBatchNorm(nn.BatchNorm2d):
    """Batch norm that in use lets nothing lie much farther from the mean than it can in training.

    Where a level has few pixels, what a kind of picture alone has (a profile to one side) is a large part of its
    batch's deviation, which hides how large it is: features may grow from block to block without any loss showing it.
    In use they are measured by the deviation of all pictures, and would come out tens of deviations off
    (docs/explanation/packaged_network_training.md has what came of it). Statistics and weights are those of
    ``nn.BatchNorm2d``.
    """

    def forward(self, features: Tensor) -> Tensor:
        """Returns the features, normalised."""
        normalised = super().forward(features)
        if self.training:
            return normalised
        farthest = FARTHEST * self.weight.abs()
        low, high = (self.bias - farthest)[:, None, None], (self.bias + farthest)[:, None, None]
        return torch.clamp(normalised, low.to(normalised.dtype), high.to(normalised.dtype))
