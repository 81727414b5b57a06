"""Shards and tables of coefficients as they are written, and a reader of all that a shard has."""

from pathlib import Path

import numpy as np

from pix2face.errors import InputFileError
from pix2face.face_files.coefficients import FaceCoefficients, save_coefficients
from pix2face.shards.shard_checks import verify_shard
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.pix2face.shard_files import as_earlier_versions_stored, every_layer


def write_small_shard(folder: Path, kind: str) -> None:
    """Every layer, four samples."""
    write_shard(folder / "shard-00000.h5", *every_layer(4), is_plain=kind == "plain")
    if kind.startswith("old-"):
        as_earlier_versions_stored(folder / "shard-00000.h5", kind.removeprefix("old-"))


def read_shard(path: Path) -> None:
    """Everything that readers of shards do with one; a damaged one may also be listed by ``verify_shard``."""
    problems = verify_shard(path)
    reader = ShardReader(path)
    for index in range(len(reader)):
        try:
            reader.stored(index, reader.header.layers[:-1], is_checked=True)
            _ = reader.read(index).image
        except InputFileError:
            continue
    if problems:
        raise InputFileError(problems[0])


def write_table(folder: Path) -> None:
    """Some faces with all that a table can have."""
    rng = np.random.default_rng(0)
    table = FaceCoefficients(
        model_name="synthetic",
        model_sha256="0" * 64,
        sample_ids=tuple(f"face/{index}" for index in range(9)),
        identity=rng.normal(size=(9, 12)).astype(np.float32),
        expression=rng.normal(size=(9, 6)).astype(np.float32),
        cameras=rng.normal(size=(9, 4, 4)),
        sizes_px=rng.integers(1, 500, size=(9, 2)).astype(np.int32),
        image_paths=tuple("" if index % 2 else f"pictures/{index}.jpg" for index in range(9)),
        attributes=('{"source": "test", "yaw_deg": 3.5}',) * 9,
        lighting=rng.normal(size=(9, 10)).astype(np.float32),
        rejected=(("bad", "no picture"),),
    )
    save_coefficients(table, folder / "faces.h5")
