"""What several folders of shards hold together, read once before training."""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Int32
from numpy import ndarray

from pix2face.errors import ModelMismatchError, UsageError
from pix2face.shards.layers import DEFAULT_LAYERS
from pix2face.shards.shard_reader import ShardHeader, ShardReader, shard_paths
from pix2face.shards.triplet import check_has_layers

OFFSET_SCALE_STEP_MM = 5.0


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class ShardIndex:
    """All samples of a training.

    Attributes:
        paths: The shards.
        shard: For each sample its shard.
        position: For each sample its place there.
        model_name: The one morphable model of all shards.
        model_sha256: Its hash.
        smallest_radius_mm: Distance from the origin to the nearest point of the mean face.
        pncc_scale_mm: PNCC divided by this stays within ±1.
        offset_scale_mm: So do offsets divided by this.
        licence: The terms of all shards.
        mirror_obstacle: Why samples cannot be mirrored; empty where they can.
        samples_sha256: Hash of all sample ids and stored checksums in order: tells one training set from another, also
            when samples of the same ids were rendered anew with another seed.
    """

    paths: tuple[Path, ...]
    shard: Int32[ndarray, " n"]
    position: Int32[ndarray, " n"]
    model_name: str
    model_sha256: str
    smallest_radius_mm: float
    pncc_scale_mm: float
    offset_scale_mm: float
    licence: str
    mirror_obstacle: str
    samples_sha256: str

    def __len__(self) -> int:
        return len(self.shard)


def index_shards(folders: Sequence[Path]) -> ShardIndex:
    """Opens every shard once and notes what it holds.

    Raises:
        UsageError: A folder has no shards, a shard lacks a layer that is trained on, or there is no sample at all.
        InputFileError: A shard is truncated, foreign or of a newer schema.
        ModelMismatchError: The shards are of different morphable models.
    """
    paths = [path for folder in folders for path in shard_paths(folder)]
    if not paths:
        raise UsageError("--shards: expected one folder of shards or more, found none")
    headers: list[ShardHeader] = []
    counts: list[int] = []
    digest, offset_limit = hashlib.sha256(), 0.0
    for path in paths:
        with ShardReader(path) as reader:
            check_has_layers(reader.header.layers, DEFAULT_LAYERS, str(path))
            headers.append(reader.header)
            counts.append(len(reader))
            digest.update(json.dumps([reader.sample_ids, reader.stored_checksums()]).encode())
            offset_limit = max(offset_limit, float(reader.offset_limits_mm.max(initial=0)))
    _check_same_model(paths, headers)
    if not sum(counts):
        raise UsageError(f"{_listed(folders)}: expected samples to train on, found empty shards alone")
    return ShardIndex(
        paths=tuple(paths),
        shard=np.repeat(np.arange(len(paths), dtype=np.int32), counts),
        position=np.concatenate([np.arange(count, dtype=np.int32) for count in counts]),
        model_name=headers[0].model_name,
        model_sha256=headers[0].model_sha256,
        smallest_radius_mm=headers[0].smallest_radius_mm,
        pncc_scale_mm=max(header.pncc_limit_mm for header in headers),
        offset_scale_mm=max(math.ceil(offset_limit / OFFSET_SCALE_STEP_MM), 1) * OFFSET_SCALE_STEP_MM,
        licence="; ".join(sorted({header.licence for header in headers})),
        mirror_obstacle=next((header.mirror_obstacle for header in headers if header.mirror_obstacle), ""),
        samples_sha256=digest.hexdigest(),
    )


def _check_same_model(paths: Sequence[Path], headers: Sequence[ShardHeader]) -> None:
    for path, header in zip(paths, headers, strict=True):
        if header.model_sha256 != headers[0].model_sha256:
            raise ModelMismatchError(
                f"{path} is of the morphable model {header.model_name!r} ({header.model_sha256[:12]}), "
                f"{paths[0]} of {headers[0].model_name!r} ({headers[0].model_sha256[:12]}); "
                "train on shards of one model"
            )


def _listed(folders: Sequence[Path]) -> str:
    return ", ".join(str(folder) for folder in folders)
