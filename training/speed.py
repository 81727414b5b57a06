"""How long a training will take, measured before it starts."""

import time

import torch

from pix2face.command_line import counted
from training.presets import Recipe
from training.trainer import start, train_one_epoch

TIMED_STEPS = 2


def seconds_per_image(recipe: Recipe, device: str) -> float:
    """Times a few steps of a network that is thrown away, after one to warm up. Loading samples is not in it."""
    network, optimiser = start(recipe, device)
    shape = (recipe.batch_size, 3, recipe.size_px, recipe.size_px)
    image = torch.rand(shape, generator=torch.Generator().manual_seed(0)) - 0.5
    batch = image, torch.cat([image, image], dim=1)
    for steps in (1, TIMED_STEPS):
        began = time.perf_counter()
        train_one_epoch(network, optimiser, [batch] * steps, recipe.precision, 0, lambda report: None)
    return (time.perf_counter() - began) / (TIMED_STEPS * recipe.batch_size)


def duration_in_words(seconds: float) -> str:
    """Such as "2 minutes" or "12 days": one unit, for an estimate that is no better than that."""
    for unit, length in (("day", 86_400), ("hour", 3_600), ("minute", 60)):
        if seconds >= 2 * length:
            return counted(round(seconds / length), unit)
    return counted(round(seconds), "second")
