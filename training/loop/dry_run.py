"""One batch through everything: whether a training can start, what it takes, how long it will last."""

import time
from dataclasses import replace

import torch

from pix2face.command_line import counted
from training.data.shard_index import ShardIndex
from training.loop.learner import Learner
from training.loop.loss_log import memory_mb
from training.loop.speed import duration_in_words
from training.loop.trainer import Surroundings, check_plan, new_learner, new_loader
from training.recipe.recipe import Recipe

# The first step warms up; some more are timed.
STEPS = 4


def dry_run(shards: ShardIndex, recipe: Recipe, surroundings: Surroundings) -> list[str]:
    """Loads one batch, learns from it some times, and writes nothing.

    Returns:
        Lines about sizes, losses, memory and times.

    Raises:
        UsageError: Arguments do not go together.
        InputFileError: A sample of the batch is damaged.
        Pix2FaceError: The loss is not finite.
    """
    check_plan(shards, recipe, surroundings.processes)
    began = time.perf_counter()
    batch = next(new_loader(shards, recipe, replace(surroundings, workers=0, cache_bytes=0)).batches(0, 1))
    loading_seconds = time.perf_counter() - began
    learner = new_learner(shards, recipe, surroundings)
    losses = [learner.step(batch)]
    began = time.perf_counter()
    losses += [learner.step(batch) for _ in range(STEPS - 1)]
    seconds = (time.perf_counter() - began) / (STEPS - 1)
    learner.check_weights()
    first, last = losses[0], losses[-1]
    lines = {
        "samples": shards.description,
        "batch": f"{recipe.batch_size} pictures of {recipe.size_px} px, loaded in {1000 * loading_seconds:.0f} ms",
        "network": _size_of(learner, recipe),
        "losses": ", ".join(f"{name} {value:.4f}" for name, value in first.parts.items())
        + f"; in all {first.total:.4f}, after {STEPS - 1} steps with this batch {last.total:.4f}",
        "step": f"{1000 * seconds:.0f} ms, {recipe.batch_size / seconds:.1f} pictures a second",
        "memory": _memory(surroundings.device),
        "takes": f"about {duration_in_words(seconds * recipe.steps)} for {counted(recipe.steps, 'step')} "
        f"({recipe.steps * recipe.batch_size} pictures), if loading keeps up",
    }
    return [f"{name:<8} {text}" for name, text in lines.items()]


def _size_of(learner: Learner, recipe: Recipe) -> str:
    n_weights = sum(parameter.numel() for parameter in learner.network.parameters())
    widths = "-".join(str(width) for width in recipe.widths)
    return f"{recipe.architecture} {widths}, {recipe.planes} planes, {n_weights / 1e6:.2f} million weights"


def _memory(device: str) -> str:
    own = f"{memory_mb():.0f} MB"
    if device.startswith("cuda"):
        return f"{torch.cuda.max_memory_allocated(device) / 1e6:.0f} MB of the GPU's, {own} of the machine's"
    return own
