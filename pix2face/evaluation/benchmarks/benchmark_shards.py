"""Benchmarks of renders: shards of triplets, whose truth comes from the renderer."""

from functools import partial
from pathlib import Path

import numpy as np

from pix2face.errors import InputFileError, ModelMismatchError, UsageError
from pix2face.evaluation.benchmarks.benchmark_data import (
    BenchmarkFace,
    BenchmarkFiles,
    BenchmarkItem,
    Unreadable,
    yaw_bin,
)
from pix2face.evaluation.benchmarks.manifest import Manifest
from pix2face.geometry.camera import head_pose
from pix2face.models.morphable_model import MorphableModel
from pix2face.shards.shard_reader import ShardReader, shard_paths


def find_shards(manifest: Manifest, data: Path, model: MorphableModel) -> BenchmarkFiles:
    """The samples of a split in a folder of shards.

    Raises:
        UsageError: The shards hold other faces.
        ModelMismatchError: They are of another model.
    """
    folders = [data / home for home in manifest.homes if any((data / home).glob("shard-*.h5"))]
    items: list[BenchmarkItem] = []
    unreadable: list[Unreadable] = []
    for path in shard_paths(folders[0]) if folders else []:
        try:
            reader = ShardReader(path)
            _check_model(path, reader, model)
            sample_ids = list(reader.sample_ids)
            # Without `by`, damaged attributes count against their own sample alone, when it is read.
            attributes = reader.attributes() if manifest.by else [{} for _ in sample_ids]
        except InputFileError as error:
            unreadable.append(Unreadable(path.name, str(error)))
            continue
        _check_samples(path, sample_ids, manifest)
        items += [
            BenchmarkItem(sample_id, partial(read_shard_face, path, index), attributes[index])
            for index, sample_id in enumerate(sample_ids)
        ]
    there = {item.name for item in items}
    missing = tuple(sample_id for sample_id in manifest.sample_ids if sample_id not in there)
    return BenchmarkFiles(tuple(items), missing, tuple(unreadable), missing)


def _check_samples(path: Path, sample_ids: list[str], manifest: Manifest) -> None:
    """Refuses samples that are not of the split: a network may have been trained on them."""
    expected = manifest.sample_ids
    foreign = sorted(set(sample_ids) - set(expected))
    if foreign:
        raise UsageError(
            f"{path}: expected the samples {expected[0]} to {expected[-1]} of {manifest.split}, found {foreign[0]}. "
            f"{manifest.how_to_get_it}"
        )


def _check_model(path: Path, reader: ShardReader, model: MorphableModel) -> None:
    if reader.header.model_sha256 != model.sha256:
        raise ModelMismatchError(
            f"{path}: shard of the model {reader.header.model_name} ({reader.header.model_sha256[:12]}), evaluation "
            f"with {model.name} ({model.sha256[:12]}); pass --model of the shard, or render shards of this model"
        )


def read_shard_face(path: Path, index: int) -> BenchmarkFace:
    """A sample of a shard with its truth.

    Raises:
        InputFileError: It is damaged, or has no picture.
    """
    reader = ShardReader(path)
    sample = reader.read(index)
    image = sample.image
    pose = head_pose(sample.camera)
    return BenchmarkFace(
        name=sample.sample_id,
        group=yaw_bin(pose.yaw_deg),
        landmarks2d=sample.landmarks2d.astype(np.float64),
        read_image=lambda: image,
        yaw_deg=pose.yaw_deg,
        pose=pose,
        maps=sample.maps,
        identity=sample.identity,
        expression=sample.expression,
    )
