"""Shards and a recipe in, a checkpoint out.

``train`` is the whole: it resumes, runs the epochs, and leaves a checkpoint and the state to go on from after each.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import final

import cv2
import torch
from torch import Tensor
from torch.utils.data import DataLoader

from pix2face.checkpoint import CheckpointHeader, save_checkpoint
from pix2face.errors import Pix2FaceError
from pix2face.networks.paper import UNet, paper_widths
from pix2face.runs import CHECKPOINT_NAME
from training.dataset import EpochDraws, TripletDataset
from training.loss_log import LossLog, StepReport
from training.losses import map_loss
from training.presets import Precision, Recipe
from training.resume import epochs_done, load_resume_state, save_resume_state
from training.schedule import learning_rate
from training.shard_index import ShardIndex

RESUME_NAME = "resume.safetensors"
LOG_NAME = "log.jsonl"

# Source: Crispell and Bazik 2017, Sec. 3.2.
ADAM_BETAS = (0.5, 0.9)

Batch = tuple[Tensor, Tensor]


@final
@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What a training runs on. It changes the speed, not the plan.

    Attributes:
        device: Name of a torch device.
        workers: Processes that decode and jitter samples; 0 does it between steps.
        cache_bytes: Memory for decoded samples, over all workers together.
    """

    device: str
    workers: int
    cache_bytes: int


def train(
    shards: ShardIndex,
    recipe: Recipe,
    out: Path,
    surroundings: Surroundings,
    *,
    on_step: Callable[[StepReport], None] = lambda report: None,
) -> Path:
    """Trains until the recipe is done, from where an earlier call with the same arguments was interrupted.

    Args:
        shards: The samples.
        recipe: What to do.
        out: Folder of the checkpoint, the state to resume from, and the log.
        surroundings: Where to do it.
        on_step: Is told of every step.

    Returns:
        The checkpoint.

    Raises:
        UsageError: ``out`` holds a training with another configuration.
        InputFileError: A shard or the state to resume from cannot be read.
        Pix2FaceError: The loss is not finite any more.
    """
    recipe.check()
    configuration = training_configuration(shards, recipe)
    network, optimiser = start(recipe, surroundings.device)
    done = epochs_done(out / RESUME_NAME, configuration)
    if done:
        load_resume_state(out / RESUME_NAME, network, optimiser)
    log = LossLog(out / LOG_NAME, done)
    draws, loader = batches(shards, recipe, surroundings)

    def report(step: StepReport) -> None:
        log.add(step)
        on_step(step)

    for epoch in range(done, recipe.epochs):
        draws.epoch = epoch
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(epoch, recipe.epochs, recipe.learning_rate)
        train_one_epoch(network, optimiser, _readable(loader), recipe.precision, epoch, report)
        log.flush()
        header = checkpoint_header(shards, recipe, configuration, epoch + 1)
        save_checkpoint(out / CHECKPOINT_NAME, header, network)
        save_resume_state(out / RESUME_NAME, network, optimiser, configuration, epoch + 1)
    return out / CHECKPOINT_NAME


def train_one_epoch(
    network: UNet,
    optimiser: torch.optim.Optimizer,
    loader: Iterable[Batch],
    precision: Precision,
    epoch: int,
    on_step: Callable[[StepReport], None],
) -> None:
    """One pass over a loader.

    Raises:
        Pix2FaceError: Loss or weights are not finite any more.
    """
    device = next(network.parameters()).device
    rate = float(optimiser.param_groups[0]["lr"])
    for step, (image, target) in enumerate(loader, start=1):
        with torch.autocast(device.type, dtype=torch.bfloat16, enabled=precision == "bfloat16"):
            planes = network(image.to(device, non_blocking=True))
        loss = map_loss(planes.float(), target.to(device, non_blocking=True))
        total = loss.total
        _check_finite(total, f"the loss is {total.item()}", epoch, step)
        optimiser.zero_grad()
        total.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        on_step(
            StepReport(
                epoch=epoch,
                step=step,
                images=len(image),
                loss=total.item(),
                pncc=loss.pncc.item(),
                offset=loss.offset.item(),
                learning_rate=rate,
            )
        )
    # The last step's weights have met no loss yet, and are about to replace a sound checkpoint.
    for parameter in network.parameters():
        _check_finite(parameter, "the weights are not finite", epoch, step)


def start(recipe: Recipe, device: str) -> tuple[UNet, torch.optim.Adam]:
    """The network and its optimiser before the first step; they depend on the recipe alone."""
    with torch.random.fork_rng():
        torch.manual_seed(recipe.seed)
        network = UNet(recipe.size_px, recipe.filters)
    network = network.to(device)
    return network, torch.optim.Adam(network.parameters(), lr=recipe.learning_rate, betas=ADAM_BETAS, fused=True)


def batches(shards: ShardIndex, recipe: Recipe, surroundings: Surroundings) -> tuple[EpochDraws, DataLoader[Batch]]:
    """The loader, and the handle that says which epoch it loads next."""
    workers = surroundings.workers
    dataset = TripletDataset(shards, recipe, surroundings.cache_bytes // max(workers, 1))
    draws = EpochDraws(recipe.epoch_size)
    loader: DataLoader[Batch] = DataLoader(
        dataset,
        batch_size=recipe.batch_size,
        sampler=draws,
        num_workers=workers,
        persistent_workers=workers > 0,
        # Forking a process with threads may hang it.
        multiprocessing_context="spawn" if workers else None,
        worker_init_fn=_with_one_thread,
        pin_memory=surroundings.device.startswith("cuda"),
    )
    return draws, loader


def training_configuration(shards: ShardIndex, recipe: Recipe) -> str:
    """What the weights depend on, as JSON: two trainings with the same one are the same training."""
    data = {
        "samples": len(shards),
        "samples_sha256": shards.samples_sha256,
        "model_sha256": shards.model_sha256,
        "pncc_scale_mm": shards.pncc_scale_mm,
        "offset_scale_mm": shards.offset_scale_mm,
    }
    return json.dumps(asdict(recipe) | data, sort_keys=True)


def checkpoint_header(shards: ShardIndex, recipe: Recipe, configuration: str, epoch: int) -> CheckpointHeader:
    """What a checkpoint of this training says of itself."""
    return CheckpointHeader(
        model_name=shards.model_name,
        model_sha256=shards.model_sha256,
        size_px=recipe.size_px,
        widths=paper_widths(recipe.size_px, recipe.filters),
        pncc_scale_mm=shards.pncc_scale_mm,
        offset_scale_mm=shards.offset_scale_mm,
        smallest_radius_mm=shards.smallest_radius_mm,
        licence=shards.licence,
        configuration=configuration,
        epoch=epoch,
    )


def _with_one_thread(worker: int) -> None:
    """Workers run side by side; OpenCV's threads in each of them would only be in each other's way."""
    cv2.setNumThreads(1)


def _readable(loader: Iterable[Batch]) -> Iterator[Batch]:
    """Passes batches on; an error of ours that a worker wrapped in its traceback becomes one line again."""
    try:
        yield from loader
    except Pix2FaceError as error:
        last_line = str(error).strip().splitlines()[-1]
        raise type(error)(last_line.removeprefix(f"{type(error).__module__}.{type(error).__name__}: ")) from error


def _check_finite(values: Tensor, what: str, epoch: int, step: int) -> None:
    if not bool(torch.isfinite(values).all()):
        raise Pix2FaceError(
            f"epoch {epoch + 1}, step {step}: {what}. The checkpoint of the last complete epoch is kept, where "
            "there is one. Try a lower --learning-rate or --precision float32; `datagen verify` checks the shards"
        )
