"""How long a training will take, measured before it starts."""

import time

import torch

from pix2face.command_line import counted
from training.data.batches import Batch
from training.loop.learner import Learner
from training.loop.losses import LossPlan
from training.recipe.recipe import Recipe

TIMED_STEPS = 2


def seconds_per_image(recipe: Recipe, device: str) -> float:
    """Times a few steps of a network that is thrown away, after one to warm up. Loading samples is not in it."""
    plan = LossPlan(pncc_scale_mm=100.0, offset_scale_mm=10.0, weights=recipe.weights, over=recipe.loss_over)
    learner, batch = Learner(recipe, plan, device), random_batch(recipe)
    for steps in (1, TIMED_STEPS):
        began = time.perf_counter()
        for _ in range(steps):
            learner.step(batch)
    return (time.perf_counter() - began) / (TIMED_STEPS * recipe.batch_size)


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
    )


def duration_in_words(seconds: float) -> str:
    """Such as "2 minutes" or "12 days": one unit, for an estimate that is no better than that."""
    for unit, length in (("day", 86_400), ("hour", 3_600), ("minute", 60)):
        if seconds >= 2 * length:
            return counted(round(seconds / length), unit)
    return counted(round(seconds), "second")
