"""Fits and what the network saw, as they go from the processes that make them to the trainer."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from mmap import mmap
from typing import final

import torch
from jaxtyping import Bool, Float16, Float32
from torch import Tensor

from pix2face.networks.correction import WIDTHS

# The outermost of the levels of features has an eighth of the side of the network's input.
STRIDE = 8


@final
@dataclass(frozen=True, kw_only=True)
class FitShape:
    """The numbers of which a batch of fits consists."""

    size_px: int  # side of the network's input
    level_widths: tuple[int, ...]  # filters of the levels of features, from the outermost inwards
    coefficients: int  # number of coefficients
    points: int  # number of points of the face that are compared

    @property
    def levels(self) -> list[tuple[int, int, int]]:
        """Height, width and filters of the features of each level."""
        sides = [self.size_px // STRIDE // 2**level for level in range(len(WIDTHS))]
        return [(side, side, width) for side, width in zip(sides, self.level_widths, strict=True)]


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class FitBatch:
    """Fits to the maps of some crops, and the true faces. Places are in units of the crop's side, from its middle."""

    levels: tuple[Float16[Tensor, "b _ _ _"], ...]  # features of the network
    cameras: Float32[Tensor, "b 2 4"]  # rows of the fitted cameras, from mm
    coefficients: Float32[Tensor, "b c"]  # fitted, standard deviations
    is_fitted: Bool[Tensor, " b"]  # False where the maps held no face; such rows do not count
    true_cameras: Float32[Tensor, "b 2 4"]  # likewise; affine, also where the face was seen in perspective
    true_coefficients: Float32[Tensor, "b c"]
    points2d: Float32[Tensor, "b p 2"]  # true places of some points of the face

    def __len__(self) -> int:
        return len(self.cameras)

    def network_input(self) -> tuple[Sequence[Tensor], Tensor, Tensor]:
        """What ``FitCorrection`` takes."""
        levels = [level.permute(0, 3, 1, 2).float() for level in self.levels]
        return levels, self.cameras, self.coefficients

    def to(self, device: torch.device | str, *, non_blocking: bool = False) -> "FitBatch":
        """Returns the batch on another device."""
        return self._each(lambda tensor: tensor.to(device, non_blocking=non_blocking))

    def pin_memory(self) -> "FitBatch":
        """Returns the batch in pinned memory, from which a GPU copies by itself."""
        return self._each(lambda tensor: tensor.pin_memory())

    def rows(self, first: int, end: int) -> "FitBatch":
        """Some of the fits, not copied."""
        return self._each(lambda tensor: tensor[first:end])

    def _each(self, change: Callable[[Tensor], Tensor]) -> "FitBatch":
        others = {name: change(tensor) for name, tensor in vars(self).items() if name != "levels"}
        return FitBatch(levels=tuple(change(level) for level in self.levels), **others)


def batch_bytes(n_fits: int, shape: FitShape) -> int:
    """The memory that a batch takes."""
    return sum(_sizes(n_fits, shape))


def empty_batch(n_fits: int, shape: FitShape, memory: mmap | None = None) -> FitBatch:
    """A batch in some memory of ``batch_bytes``, which may hold a batch already; None takes new memory, full of 0."""
    sizes = _sizes(n_fits, shape)
    content = (
        torch.zeros(sum(sizes), dtype=torch.uint8) if memory is None else torch.frombuffer(memory, dtype=torch.uint8)
    )
    cameras, true_cameras, coefficients, true_coefficients, points2d, *levels, fitted = torch.split_with_sizes(
        content, sizes
    )
    return FitBatch(
        levels=tuple(
            own.view(torch.float16).view(n_fits, *level) for own, level in zip(levels, shape.levels, strict=True)
        ),
        cameras=cameras.view(torch.float32).view(n_fits, 2, 4),
        coefficients=coefficients.view(torch.float32).view(n_fits, shape.coefficients),
        is_fitted=fitted.view(torch.bool),
        true_cameras=true_cameras.view(torch.float32).view(n_fits, 2, 4),
        true_coefficients=true_coefficients.view(torch.float32).view(n_fits, shape.coefficients),
        points2d=points2d.view(torch.float32).view(n_fits, shape.points, 2),
    )


def _sizes(n_fits: int, shape: FitShape) -> list[int]:
    """Bytes of each part, numbers of four bytes first."""
    singles = [8, 8, shape.coefficients, shape.coefficients, 2 * shape.points]
    halves = [height * width * filters for height, width, filters in shape.levels]
    return [4 * n_fits * count for count in singles] + [2 * n_fits * count for count in halves] + [n_fits]
