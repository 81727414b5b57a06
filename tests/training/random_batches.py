"""Batches of noise."""

import torch

from training.data.batches import Batch
from training.recipe.recipe import Recipe


def random_batch(recipe: Recipe, seed: int = 0) -> Batch:
    """A batch of noise, of the size that a recipe takes."""
    random = torch.Generator().manual_seed(seed)
    shape = (recipe.batch_size, 3, recipe.size_px, recipe.size_px)
    one_plane = (recipe.batch_size, recipe.size_px, recipe.size_px)

    def drawn(low: int, high: int, size: tuple[int, ...], dtype: torch.dtype) -> torch.Tensor:
        return torch.randint(low, high, size, generator=random, dtype=dtype)

    return Batch(
        image=drawn(0, 256, shape, torch.uint8),
        pncc=drawn(-1000, 1000, shape, torch.int16),
        offset=drawn(-1000, 1000, shape, torch.int16),
        mask=drawn(0, 2, one_plane, torch.uint8),
        seen=drawn(0, 2, one_plane, torch.uint8),
        landmarks2d=recipe.size_px * torch.rand(recipe.batch_size, recipe.n_landmarks, 2, generator=random),
    )
