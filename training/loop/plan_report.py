"""A summary of the plan of a training; and a dry run, which takes some steps and reports their time and memory."""

import time
from dataclasses import replace
from pathlib import Path

import torch
from rich.text import Text

from pix2face.command_line import counted, printable
from pix2face.inference import CHECKPOINT_NAME
from training.data.shard_index import ShardIndex
from training.loop.learner import computed_precision
from training.loop.loss_log import memory_mb
from training.loop.tasks import MapTask, Surroundings, check_plan
from training.recipe.recipe import Recipe

# Of a dry run. The first step warms up; the others are timed.
STEPS = 4


def summary(shards: ShardIndex, recipe: Recipe, preset: str, device: str, out: Path, done: int) -> Text:
    """Samples, model, plan and output. ``done`` is the number of samples that an interrupted run has seen."""
    lines = {
        "samples": shards.description,
        "model": f"{shards.model_name} ({shards.model_sha256[:12]})",
        "terms": shards.licence,
        "scales": f"PNCC {shards.pncc_scale_mm:.0f} mm, offset {shards.offset_scale_mm:.0f} mm",
        "preset": f"{preset}: {recipe.architecture}, {recipe.size_px} px, {counted(recipe.filters, 'filter')}, "
        f"{recipe.planes} planes, batches of {recipe.batch_size}, {computed_precision(recipe.precision, device)}",
        "plan": f"{counted(recipe.epochs, 'epoch')} of {counted(recipe.epoch_size, 'picture')}"
        + (f", {counted(done, 'picture')} done" if done else ""),
        "writes": str(out / CHECKPOINT_NAME),
    }
    return Text("\n".join(f"{name:<8} {printable(text)}" for name, text in lines.items()))


def dry_run(shards: ShardIndex, recipe: Recipe, surroundings: Surroundings) -> list[str]:
    """Loads one batch, takes some steps with it, and returns lines about sizes, losses, memory and times.

    Raises:
        UsageError: Arguments do not go together.
        InputFileError: A sample of the batch is damaged.
        Pix2FaceError: The loss is not finite.
    """
    check_plan(shards, recipe, surroundings.processes)
    task, began = MapTask(shards, recipe), time.perf_counter()
    batch = next(task.new_loader(replace(surroundings, workers=0, cache_bytes=0)).batches(0, 1))
    loading_seconds = time.perf_counter() - began
    learner = task.new_learner(surroundings)
    losses = [learner.step(batch)]
    began = time.perf_counter()
    losses += [learner.step(batch) for _ in range(STEPS - 1)]
    seconds = (time.perf_counter() - began) / (STEPS - 1)
    learner.check_weights()
    first, last = losses[0], losses[-1]
    n_weights = sum(parameter.numel() for parameter in learner.network.parameters())
    widths = "-".join(str(width) for width in recipe.widths)
    lines = {
        "samples": shards.description,
        "batch": f"{recipe.batch_size} pictures of {recipe.size_px} px, loaded in {1000 * loading_seconds:.0f} ms",
        "network": f"{recipe.architecture} {widths}, {recipe.planes} planes, {n_weights / 1e6:.2f} million weights",
        "losses": ", ".join(f"{name} {value:.4f}" for name, value in first.parts.items())
        + f"; in all {first.total:.4f}, after {STEPS - 1} steps with this batch {last.total:.4f}",
        "step": f"{1000 * seconds:.0f} ms, {recipe.batch_size / seconds:.1f} pictures a second",
        "memory": _memory(surroundings.device),
        "takes": f"about {duration_in_words(seconds * recipe.steps)} for {counted(recipe.steps, 'step')} "
        f"({recipe.steps * recipe.batch_size} pictures), if loading keeps up",
    }
    return [f"{name:<8} {text}" for name, text in lines.items()]


def _memory(device: str) -> str:
    own = f"{memory_mb():.0f} MB"
    if device.startswith("cuda"):
        return f"{torch.cuda.max_memory_allocated(device) / 1e6:.0f} MB of the GPU's, {own} of the machine's"
    return own


def duration_in_words(seconds: float) -> str:
    """Such as "2 minutes" or "12 days": one unit, for an estimate that is no better than that."""
    for unit, length in (("day", 86_400), ("hour", 3_600), ("minute", 60)):
        if seconds >= 2 * length:
            return counted(round(seconds / length), unit)
    return counted(round(seconds), "second")
