"""The command line of ``train``: what to do, and where."""

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, final

import torch

from pix2face.errors import UsageError
from pix2face.networks.architectures import ArchitectureName
from training.loop.processes import Processes, device_of_process
from training.loop.trainer import Surroundings
from training.recipe.presets import PRESETS, PresetName
from training.recipe.recipe import Cropping, LossOver, Precision, Recipe
from training.recipe.schedule import ScheduleName

# Options that stand in place of the preset's number of the same name.
_OVERRIDABLE = (
    *("epochs", "epoch_size", "batch_size", "parts", "architecture", "size_px", "filters", "planes"),
    *("learning_rate", "schedule", "warm_up", "precision", "loss_over", "clip", "ema", "norm_batches"),
    *("cropping", "crop_scale", "seed"),
)
_WEIGHTS = ("pncc", "offset", "mask", "seen")


@final
@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Where an option says so, or its default is None, the preset's value holds.

    Attributes:
        shards: Folders of shards, all of one morphable model. FOLDER:0.7 gives a folder its share of the draws.
        out: Folder of the checkpoint, the log and the state to resume from; default runs/PRESET.
        preset: paper: 256 px, 64 filters, 60 epochs of 100,000 pictures; asks for a GPU. tiny: two minutes, two cores.
            cpu: 128 px, residual network, half an hour on two idle cores. gpu: the same network at 256 px.
        init: A checkpoint whose weights are started from. Fully convolutional networks (residual) go on at any size:
            most pictures can be seen small first.
        epochs: Of --epoch-size pictures each; a checkpoint is written after each.
        epoch_size: Pictures an epoch, drawn over and over with ever new jitter; whole batches, rounded up.
        samples: Pictures of the whole training, instead of epochs; rounded up to whole epochs of the same size.
        batch_size: Pictures a step, over all processes.
        parts: A batch is computed in so many parts, one after the other, to save memory.
        architecture: paper or residual.
        size_px: Side of the network's input: a power of two (paper), a multiple of 64 (residual).
        filters: Filters of the network's first level.
        planes: Of the output: 6 maps; 7 with the mask; 8 with its seen part, too (needs shards that know it).
        learning_rate: Adam's largest.
        schedule: paper: falls to 0.021 of that from epoch to epoch. cosine, linear: to 0, with each step.
        warm_up: Pictures over which the rate first rises from 0 (cosine, linear).
        precision: Arithmetic of the network's layers.
        weight_pncc: Of PNCC's mean absolute error in the loss.
        weight_offset: Of the offsets'.
        weight_mask: Of the mask's cross entropy.
        weight_seen: Of the cross entropy of its seen part.
        loss_over: Pixels over which errors of maps are averaged: all of them, the mask, or its seen part.
        clip: Largest norm of the gradient; 0 for any.
        ema: Decay of the running mean of the weights that the checkpoint holds; 0 for none.
        norm_batches: Over so many batches batch norms are measured again after the last step; 0 leaves them.
        cropping: full: turned, scaled and shifted as the paper does. box: --crop-scale boxes of the face, a few percent
            off, as when the network is used; much faster. shift: squares of whole pixels out of pictures that are
            larger than the input, wherever faces are in them; as fast. none: their middle, in their own colours.
        crop_scale: Side of the crop that the network is given of a face when it is used, in units of the longer side of
            the face's box; stored in the checkpoint.
        mirror: Mirror every other sample. The paper does not; refused where the model is not symmetric.
        seed: Of the first weights, the order of the samples and their jitter.
        where: Train on samples whose attributes fulfil this alone.
        validation: Share of the persons that are held out to measure on; 0 measures nothing.
        validation_samples: At most so many of their pictures.
        validate_every: Pictures between two measurements; None measures after each epoch.
        restart: Replace what the output folder holds of an earlier training.
        state_minutes: The state to go on from is written so often, beside the ends of epochs and signals.
        compile: Let torch.compile make the network faster; takes a minute, and a C++ compiler.
        tensorboard: Write curves and pictures for TensorBoard into the output folder (extra: tensorboard).
        dry_run: Take one step with one batch, say what it took, and write nothing.
        workers: Processes that load samples; None takes one for each second core, at most 8.
        cache_gb: Memory for decoded samples, over all workers.
        device: cpu, cuda, cuda:1, ...; None takes a GPU where there is one.
    """

    shards: tuple[str, ...]
    out: Path | None = None
    preset: PresetName = "paper"
    init: Path | None = None
    epochs: int | None = None
    epoch_size: int | None = None
    samples: int | None = None
    batch_size: int | None = None
    parts: int | None = None
    architecture: ArchitectureName | None = None
    size_px: int | None = None
    filters: int | None = None
    planes: int | None = None
    learning_rate: float | None = None
    schedule: ScheduleName | None = None
    warm_up: int | None = None
    precision: Precision | None = None
    weight_pncc: float | None = None
    weight_offset: float | None = None
    weight_mask: float | None = None
    weight_seen: float | None = None
    loss_over: LossOver | None = None
    clip: float | None = None
    ema: float | None = None
    norm_batches: int | None = None
    cropping: Cropping | None = None
    crop_scale: float | None = None
    mirror: Literal["yes", "no"] | None = None
    seed: int | None = None
    where: str = ""
    validation: float = 0.0
    validation_samples: int = 200
    validate_every: int | None = None
    restart: bool = False
    state_minutes: float = 10.0
    compile: bool = False
    tensorboard: bool = False
    dry_run: bool = False
    workers: int | None = None
    cache_gb: float = 1.0
    device: str | None = None

    def recipe(self) -> Recipe:
        """The preset with what was given in its place.

        Raises:
            UsageError: A number makes no sense.
        """
        recipe = replace(PRESETS[self.preset], **self._given(_OVERRIDABLE))
        weights = {name: getattr(self, f"weight_{name}") for name in _WEIGHTS}
        given = {name: weight for name, weight in weights.items() if weight is not None}
        recipe = replace(recipe, weights=replace(recipe.weights, **given))
        if self.mirror is not None:
            recipe = replace(recipe, jitter=replace(recipe.jitter, mirror=self.mirror == "yes"))
        recipe.check()
        return recipe if self.samples is None else self._of_samples(recipe, self.samples)

    def surroundings(self, processes: Processes) -> Surroundings:
        """The machine.

        Raises:
            UsageError: A number makes no sense.
        """
        for name, least in (("cache_gb", 0.0), ("workers", 0), ("state_minutes", 0.0)):
            value = getattr(self, name)
            if value is not None and not least <= value < math.inf:
                unit = " (in 10^9 bytes)" if name == "cache_gb" else ""
                raise UsageError(f"--{name.replace('_', '-')}: expected 0 or more{unit}, found {value}")
        default_workers = min(max(cores() // 2, 1), 8)
        return Surroundings(
            device=self.checked_device(),
            workers=default_workers if self.workers is None else self.workers,
            cache_bytes=int(self.cache_gb * 1e9),
            is_compiled=self.compile,
            state_minutes=self.state_minutes,
            processes=processes,
        )

    def checked_device(self) -> str:
        """The device of this process.

        Raises:
            UsageError: The machine has no such device.
        """
        device = device_of_process(self.device or ("cuda" if torch.cuda.is_available() else "cpu"))
        try:
            torch.zeros(1, device=device).item()  # some devices only pretend to hold numbers
        except (RuntimeError, AssertionError, ImportError) as error:
            raise UsageError(
                f"--device {device}: {str(error).splitlines()[0]}; leave it out to take what is there"
            ) from error
        return device

    def _given(self, names: tuple[str, ...]) -> dict[str, Any]:
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    def _of_samples(self, recipe: Recipe, samples: int) -> Recipe:
        """The recipe for so many pictures, in epochs of about the size that it has."""
        if self.epochs is not None:
            raise UsageError("--samples: expected it or --epochs, found both")
        if samples <= 0:
            raise UsageError(f"--samples: expected more than 0, found {samples}")
        epochs = math.ceil(samples / recipe.epoch_size)
        return replace(recipe, epochs=epochs, epoch_size=math.ceil(samples / epochs))


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
