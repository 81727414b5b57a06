"""A network with its optimiser and the running mean of its weights; each call takes one step of training."""

import copy
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import chain
from typing import Any, Protocol, final, runtime_checkable

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import update_bn

from pix2face.errors import Pix2FaceError
from training.data.batches import TrainingBatch
from training.loop.processes import Processes
from training.recipe.recipe import Precision, StepRecipe
from training.recipe.schedule import learning_rate, smooth_rate

# Source: Crispell and Bazik 2017, Sec. 3.2.
ADAM_BETAS = (0.5, 0.9)

# Averaging every fourth step with the fourth power of the decay is as smooth, at a quarter of the time.
STEPS_BETWEEN = 4

ALONE = Processes()


@final
class RunningMean:
    """An exponential running mean of the weights of a network and of the statistics of its norms.

    ``decay`` is the share of the mean that is left after a step. In the first 1 / (1 - decay) steps it is smaller, so
    that the initial weights do not linger.
    """

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.network = copy.deepcopy(network).eval().requires_grad_(False)
        self._decay = decay

    @torch.no_grad()
    def follow(self, network: nn.Module, step: int) -> None:
        """Takes in the weights of the network after a step, which is counted from 1."""
        if step % STEPS_BETWEEN:
            return
        decay = min(self._decay, (1 + step) / (10 + step)) ** STEPS_BETWEEN
        means, presents = [], []
        for mean, present in zip(self.network.state_dict().values(), network.state_dict().values(), strict=True):
            if mean.is_floating_point():
                means.append(mean)
                presents.append(present)
            else:
                mean.copy_(present)
        torch._foreach_lerp_(means, presents, 1 - decay)


@final
@dataclass(frozen=True, kw_only=True)
class StepLosses:
    """The losses of a step, before it changed the weights."""

    total: float  # what is minimised
    parts: dict[str, float]  # unweighted, by name
    learning_rate: float


@runtime_checkable
class Losses(Protocol):
    """What a network's answer is compared with, and how."""

    def parts(self, answer: Any, batch: Any) -> dict[str, Tensor]:
        """Each part of the loss by its name, unweighted."""

    def total(self, parts: dict[str, Tensor]) -> Tensor:
        """What is minimised."""


@final
class Learner:
    """Network, optimiser and running mean.

    Args:
        recipe: How long and how fast.
        new_network: Makes the network; what it draws depends on the recipe's seed alone.
        plan: The losses.
        device: Name of a torch device.
        processes: All that share the work.
        is_compiled: Whether torch.compile makes the passes through the network faster, which first takes a minute.
    """

    def __init__(
        self,
        recipe: StepRecipe,
        new_network: Callable[[], nn.Module],
        plan: Losses,
        device: str,
        processes: Processes = ALONE,
        is_compiled: bool = False,
    ) -> None:
        self._recipe, self._plan, self._processes = recipe, plan, processes
        with torch.random.fork_rng():
            torch.manual_seed(recipe.seed)
            self.network = new_network().to(device)
        self.optimiser = torch.optim.Adam(
            self.network.parameters(), lr=recipe.learning_rate, betas=ADAM_BETAS, fused=True
        )
        self.mean = RunningMean(self.network, recipe.ema) if recipe.ema else None
        self.steps_done = 0
        self._device = torch.device(device)
        self._in_bfloat16 = computed_precision(recipe.precision, device) == "bfloat16"
        self._passes = processes.joined(self.network)
        if is_compiled:
            self._passes = torch.compile(self._passes)  # type: ignore[assignment]

    @property
    def result(self) -> nn.Module:
        """The network for a checkpoint: the running mean if there is one."""
        return self.mean.network if self.mean else self.network

    def start_from(self, network: nn.Module) -> None:
        """Takes over the weights of another training, before the first step. Outputs that it lacks start anew."""
        own = self.network.state_dict()
        for name, found in network.state_dict().items():
            if found.ndim:
                own[name][: len(found)] = found
            else:
                own[name] = found
        for started in (self.network, self.mean.network if self.mean else self.network):
            started.load_state_dict(own)

    def step(self, batch: TrainingBatch) -> StepLosses:
        """Learns from one batch (this process's part of it).

        Raises:
            Pix2FaceError: The loss, or the norm of a gradient that is clipped, is not finite.
        """
        self.network.train()
        # What a step draws (dropout) depends on its number alone, so an interrupted training goes on exactly.
        torch.manual_seed(self._recipe.seed + self.steps_done)
        rate = self._rate()
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        self.optimiser.zero_grad()
        found = [self._backward(part, len(batch)) for part in self._parts(batch)]
        parts = {name: torch.stack([own[name] for own in found]).sum() for name in found[0]}
        means = self._processes.mean(torch.stack(list(parts.values()))).tolist()
        losses = dict(zip(parts, means, strict=True))
        total = losses.pop("total")
        if not math.isfinite(total):
            raise self._diverged(f"the loss is {total}")
        if self._recipe.clip:
            norm = nn.utils.clip_grad_norm_(self.network.parameters(), self._recipe.clip).item()
            if not math.isfinite(norm):
                raise self._diverged(f"the gradient's norm is {norm}")
        self.optimiser.step()
        self.steps_done += 1
        if self.mean:
            self.mean.follow(self.network, self.steps_done)
        return StepLosses(total=total, parts=losses, learning_rate=rate)

    @property
    def has_batch_norms(self) -> bool:
        """Whether the network has norms that ``measure_norms`` can measure."""
        return bool(self._batch_norms())

    def measure_norms(self, batches: Iterable[TrainingBatch]) -> None:
        """Measures the statistics of the batch norms of the result with its present weights.

        Running statistics mix those of earlier weights, and cover few batches. They are measured in float32, as when
        the network is used, and without the bounds of bounded norms. The result is left in evaluation mode. Without
        batches (each process takes its part of them), nothing changes.
        """
        left = iter(batches)
        first = next(left, None)
        if first is None:
            return
        self.result.train()
        update_bn(
            (batch.to(self._device, non_blocking=True).network_input() for batch in chain([first], left)), self.result
        )
        self.result.eval()
        for norm in self._batch_norms():
            for statistic in (norm.running_mean, norm.running_var):
                assert statistic is not None
                self._processes.mean(statistic)

    def _batch_norms(self) -> list[nn.BatchNorm2d]:
        return [module for module in self.result.modules() if isinstance(module, nn.BatchNorm2d)]

    def check_weights(self) -> None:
        """Makes sure that the weights after the last step, for which no loss is known yet, may be written.

        Raises:
            Pix2FaceError: A weight is not finite.
        """
        for parameter in self.network.parameters():
            if not bool(torch.isfinite(parameter).all()):
                raise self._diverged("the weights are not finite")

    def _backward(self, batch: TrainingBatch, of: int) -> dict[str, Tensor]:
        """Adds the gradient of a part of a batch of ``of`` pictures; returns its share of the losses."""
        batch = batch.to(self._device, non_blocking=True)
        with torch.autocast(self._device.type, dtype=torch.bfloat16, enabled=self._in_bfloat16):
            answer = self._passes(*batch.network_input())
        parts = self._plan.parts(answer, batch)
        share = len(batch) / of
        total = self._plan.total(parts) * share
        total.backward()  # type: ignore[no-untyped-call]
        return {"total": total.detach()} | {name: part.detach() * share for name, part in parts.items()}

    def _parts(self, batch: TrainingBatch) -> list[TrainingBatch]:
        size = len(batch) // self._recipe.parts
        return [batch[first : first + size] for first in range(0, len(batch), size)]

    def _rate(self) -> float:
        recipe = self._recipe
        if recipe.schedule == "paper":
            return learning_rate(self.steps_done // recipe.epoch_steps, recipe.epochs, recipe.learning_rate)
        warm_up_steps = recipe.warm_up // recipe.batch_size
        return recipe.learning_rate * smooth_rate(recipe.schedule, self.steps_done, recipe.steps, warm_up_steps)

    def _diverged(self, what: str) -> Pix2FaceError:
        epoch, step = divmod(self.steps_done, self._recipe.epoch_steps)
        return Pix2FaceError(
            f"epoch {epoch + 1}, step {step + 1}: {what}. The checkpoint written last is kept, where there is one. Try "
            "a lower --learning-rate or --precision float32; `datagen verify` checks the shards"
        )


def computed_precision(wanted: Precision, device: str) -> Precision:
    """The arithmetic of a training: float32 where bfloat16 would take ten times as long, on CPUs without it."""
    return wanted if torch.device(device).type != "cpu" or has_bfloat16() else "float32"


def has_bfloat16() -> bool:
    """Whether the processor has instructions for bfloat16; False if this version of PyTorch cannot tell."""
    capabilities: dict[str, object] = getattr(torch.cpu, "get_capabilities", dict)()
    return bool(capabilities.get("avx512_bf16"))
