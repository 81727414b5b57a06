"""How fast a step of training is: ``python -m tests.benchmarks.training``.

The preset ``paper`` against a plain float32 implementation of the same network in torch's own layers, planes first in
memory, from the same weights, with the same pictures, in turns; then where the time goes, and the losses of both over
some more steps (``--curve-steps 500``; at a smaller ``--curve-size-px`` that takes minutes instead of an hour); then
the residual network. Times are of the processor, summed over threads, since other jobs disturb them least; ``wall`` is
what a clock on the wall says.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
import tyro
from torch import Tensor

from tests.benchmarks.measuring import write_report
from tests.benchmarks.plain_unet import PlainUNet
from training.data.batches import Batch, as_input, target_planes
from training.loop.learner import ADAM_BETAS, Learner
from training.loop.losses import LossPlan
from training.recipe.presets import PRESETS
from training.recipe.recipe import Recipe

SCALES_MM = (100.0, 20.0)
STEPS_A_POINT = 10  # of a curve


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes:
        steps: Timed steps of each way, after one to warm up.
        threads: Of torch.
        curve_steps: Steps of the losses' curves; 0 leaves them out.
        curve_size_px: Side of the pictures of the curves.
        paper: Whether to time the preset ``paper``.
        residual: Whether to time the residual network.
    """

    steps: int = 2
    threads: int = 1
    curve_steps: int = 0
    curve_size_px: int = 256
    paper: bool = True
    residual: bool = True


class PlainTraining:
    """The same training, as a textbook would write it."""

    def __init__(self, recipe: Recipe, learner: Learner) -> None:
        self._recipe, self._done = recipe, 0
        self._network = PlainUNet(recipe.size_px, recipe.filters)
        self._network.take_weights(learner.network)  # type: ignore[arg-type]
        self._optimiser = torch.optim.Adam(self._network.parameters(), lr=recipe.learning_rate, betas=ADAM_BETAS)

    def step(self, batch: Batch) -> float:
        image, target = as_input(batch.image).contiguous(), target_planes(batch, *SCALES_MM).contiguous()
        loss = (self._network(image) - target).abs().mean()
        self._optimiser.zero_grad()
        loss.backward()
        self._optimiser.step()
        return loss.item()


def drawn_faces(recipe: Recipe, seed: int) -> Batch:
    """Pictures from which maps can be learned: shaded ellipses, turned and moved, on noise."""
    random, size = torch.Generator().manual_seed(seed), recipe.size_px
    row, column = torch.meshgrid(*[torch.linspace(-1, 1, size)] * 2, indexing="ij")
    draws = torch.rand(recipe.batch_size, 4, 1, 1, generator=random)
    x = (column - 0.6 * (draws[:, 0] - 0.5)) / (0.4 + 0.3 * draws[:, 2])
    y = (row - 0.6 * (draws[:, 1] - 0.5)) / (0.5 + 0.3 * draws[:, 2])
    mask = (x**2 + y**2 < 1).float()
    z = (1 - x**2 - y**2).clamp(min=0).sqrt() * mask
    pncc = torch.stack([80 * x * mask, -100 * y * mask, 40 + 60 * z], dim=1) * mask[:, None]
    offset = torch.stack([x, y, z], dim=1) * (10 * (draws[:, 3] - 0.5) * mask)[:, None]
    noise = torch.rand(recipe.batch_size, 3, size, size, generator=random)
    image = torch.where(mask[:, None] > 0, 0.2 + 0.5 * (0.7 * z + 0.3 * x + 0.2 * noise[:, 0])[:, None], 0.5 * noise)
    return Batch(
        image=_channels_last((image.clamp(0, 1) * 255).to(torch.uint8)),
        pncc=_channels_last((pncc * 128).to(torch.int16)),
        offset=_channels_last((offset * 128).to(torch.int16)),
        mask=mask.to(torch.uint8),
        seen=mask.to(torch.uint8),
        landmarks2d=torch.zeros(recipe.batch_size, 0, 2),
    )


def compared_steps(options: Options) -> dict[str, Any]:
    """Seconds a step of the preset, in its own precision and the other one, and of the plain way."""
    ways: dict[str, Callable[[Batch], object]] = {}
    recipe = PRESETS["paper"]
    for precision in ("bfloat16", "float32"):
        learner = new_learner(replace(recipe, precision=precision))
        ways[precision] = learner.step
    ways["plain"] = PlainTraining(recipe, new_learner(recipe)).step
    batch = drawn_faces(recipe, 0)
    seconds = timed_in_turns({name: lambda step=step: step(batch) for name, step in ways.items()}, options.steps)
    plain = seconds["plain"]["processor"]
    return {
        "seconds_a_step": seconds,
        "precision_of_the_preset": recipe.precision,
        "times_as_fast_as_plain": {name: round(plain / own["processor"], 2) for name, own in seconds.items()},
        "where_the_time_goes": {name: profile(lambda step=ways[name]: step(batch)) for name in ("bfloat16", "plain")},
    }


def curves(options: Options) -> dict[str, Any]:
    """Losses of both ways over the same pictures, means of ten steps, with the preset's first learning rate."""
    recipe = replace(PRESETS["paper"], size_px=options.curve_size_px)
    learner = new_learner(recipe)
    plain = PlainTraining(recipe, learner)
    losses: dict[str, list[float]] = {recipe.precision: [], "plain": []}
    for step in range(options.curve_steps):
        batch = drawn_faces(recipe, step)
        losses[recipe.precision].append(learner.step(batch).total)
        losses["plain"].append(plain.step(batch))
    means = {name: np.array(own).reshape(-1, STEPS_A_POINT).mean(axis=1) for name, own in losses.items()}
    last = {name: float(np.mean(own[-50:])) for name, own in losses.items()}
    return {
        "size_px": recipe.size_px,
        "filters": recipe.filters,
        "steps": options.curve_steps,
        "mean_of_the_last_50": {name: round(value, 5) for name, value in last.items()},
        "ratio": round(last[recipe.precision] / last["plain"], 4),
        "curves": {name: own.round(5).tolist() for name, own in means.items()},
    }


def residual_steps(options: Options) -> dict[str, Any]:
    """Seconds a step of the preset ``cpu`` at two sizes, and pictures a second."""
    result = {}
    for size_px in (64, 128):
        recipe = replace(PRESETS["cpu"], size_px=size_px)
        learner, batch = new_learner(recipe), drawn_faces(recipe, 0)
        own = timed_in_turns({"step": lambda learner=learner, batch=batch: learner.step(batch)}, 4 * options.steps)
        seconds = own["step"]
        result[f"{size_px} px"] = seconds | {
            "pictures_a_second_of_processor": round(recipe.batch_size / seconds["processor"], 1),
            "pictures_a_second_of_wall": round(recipe.batch_size / seconds["wall"], 1),
            "where_the_time_goes": profile(lambda learner=learner, batch=batch: learner.step(batch)),
        }
    return result


def new_learner(recipe: Recipe) -> Learner:
    plan = LossPlan(
        pncc_scale_mm=SCALES_MM[0], offset_scale_mm=SCALES_MM[1], weights=recipe.weights, over=recipe.loss_over
    )
    return Learner(recipe, recipe.new_network, plan, "cpu")


def timed_in_turns(ways: dict[str, Callable[[], object]], rounds: int) -> dict[str, dict[str, float]]:
    """Least seconds of each way, measured in turns after one round to warm up."""
    least = {name: {"processor": float("inf"), "wall": float("inf")} for name in ways}
    for turn in range(rounds + 1):
        for name, way in ways.items():
            began, began_wall = time.process_time(), time.perf_counter()
            way()
            if turn:
                least[name]["processor"] = min(least[name]["processor"], time.process_time() - began)
                least[name]["wall"] = min(least[name]["wall"], time.perf_counter() - began_wall)
    return {name: {clock: round(value, 4) for clock, value in own.items()} for name, own in least.items()}


def profile(step: Callable[[], object]) -> dict[str, float]:
    """Share of the processor's time of each operation of one step, those above 1 %."""
    activities = [torch.profiler.ProfilerActivity.CPU]
    with torch.profiler.profile(activities=activities) as profiler:
        step()
    events = profiler.key_averages()
    total = sum(event.self_cpu_time_total for event in events)
    shares = {event.key: event.self_cpu_time_total / total for event in events}
    ordered = sorted(shares.items(), key=lambda item: -item[1])
    return {name.removeprefix("aten::"): round(share, 3) for name, share in ordered if share > 0.01}


def _channels_last(planes: Tensor) -> Tensor:
    return planes.contiguous(memory_format=torch.channels_last)


def main(options: Options) -> None:
    torch.set_num_threads(options.threads)
    result: dict[str, Any] = {"threads": options.threads}
    if options.paper:
        result["preset_paper"] = compared_steps(options)
    if options.curve_steps:
        result["losses"] = curves(options)
    if options.residual:
        result["preset_cpu"] = residual_steps(options)
    write_report(result)


if __name__ == "__main__":
    main(tyro.cli(Options))
