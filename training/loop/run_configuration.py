"""The configuration of a training as its files store it, and the header of its checkpoints."""

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path

from pix2face.errors import ModelMismatchError, UsageError
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.networks.dimensions import ARCHITECTURES
from training.data.shard_index import ShardIndex
from training.recipe.recipe import Recipe


def training_configuration(shards: ShardIndex, recipe: Recipe, initial: Path | None = None) -> str:
    """Everything on which the weights depend, as JSON. Two trainings with the same configuration are the same.

    The content of the initial checkpoint counts, not its name.
    """
    start = {"initial_sha256": hashlib.sha256(initial.read_bytes()).hexdigest()} if initial else {}
    return json.dumps(asdict(recipe) | shards.configuration() | start, sort_keys=True)


def checkpoint_header(
    shards: ShardIndex, recipe: Recipe, configuration: str, epoch: int, samples: int
) -> CheckpointHeader:
    """The header of a checkpoint of this training."""
    return CheckpointHeader(
        model_name=shards.model_name,
        model_sha256=shards.model_sha256,
        size_px=recipe.size_px,
        widths=recipe.widths,
        pncc_scale_mm=shards.pncc_scale_mm,
        offset_scale_mm=shards.offset_scale_mm,
        smallest_radius_mm=shards.smallest_radius_mm,
        licence=shards.licence,
        configuration=configuration,
        epoch=epoch,
        samples=samples,
        architecture=recipe.architecture,
        planes=recipe.planes,
        n_landmarks=recipe.n_landmarks,
        crop_scale=recipe.crop_scale,
    )


def with_scales_of(initial: CheckpointHeader, shards: ShardIndex, recipe: Recipe) -> ShardIndex:
    """The samples with the scales of a checkpoint, so that its weights fit their maps.

    Raises:
        ModelMismatchError: The checkpoint is of another morphable model.
        UsageError: Its network is not that of the recipe.
    """
    if initial.model_sha256 != shards.model_sha256:
        raise ModelMismatchError(
            f"--init: expected a checkpoint of the morphable model {shards.model_name!r} ({shards.model_sha256[:12]}), "
            f"found one of {initial.model_name!r} ({initial.model_sha256[:12]})"
        )
    wanted = (recipe.architecture, recipe.widths, recipe.planes, recipe.n_landmarks)
    found = (initial.architecture, initial.widths, initial.planes, initial.n_landmarks)
    # Planes are the first ones of more planes, and landmarks are added to none.
    if wanted[:2] != found[:2] or wanted[2] < found[2] or wanted[3] < found[3]:
        raise UsageError(
            f"--init: expected a network {_named(*wanted)}, found {_named(*found)}; "
            "give --architecture, --filters and --planes as in the training that it comes from"
        )
    if initial.size_px != recipe.size_px and not ARCHITECTURES[recipe.architecture].is_any_size:
        raise UsageError(
            f"--init: expected a network for {recipe.size_px} px, found one for {initial.size_px} px; only fully "
            "convolutional networks (--architecture residual) go on at another size"
        )
    return replace(shards, pncc_scale_mm=initial.pncc_scale_mm, offset_scale_mm=initial.offset_scale_mm)


def _named(architecture: str, widths: tuple[int, ...], planes: int, n_landmarks: int) -> str:
    return f"{architecture} {'-'.join(str(width) for width in widths)} with {planes} planes, {n_landmarks} landmarks"
