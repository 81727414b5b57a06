"""Converts the shards of a folder that an earlier version wrote to today's schema."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from datagen.inspection.croissant import write_descriptions
from datagen.jobs.folder_lock import job_lock, remove_unfinished
from pix2face.errors import InputFileError
from pix2face.shards.layers import IMAGE, LAYERS
from pix2face.shards.shard_reader import ShardReader, shard_paths
from pix2face.shards.shard_writing import ShardWriter


def upgrade_folder(folder: Path, on_shard: Callable[[], None] = lambda: None) -> int:
    """Converts every shard of an earlier schema, and writes the card and the description anew if there was any.

    Each shard takes the place of the old one when it is complete and has the same content, so the work can be
    interrupted and continued. Damaged shards stay as they are. ``on_shard`` is called after each shard.

    Returns:
        How many shards were converted.

    Raises:
        UsageError: There is no shard, another job writes to the folder, or a shard cannot be written.
    """
    n_upgraded = 0
    with job_lock(folder):
        remove_unfinished(folder)
        for path in shard_paths(folder):
            n_upgraded += _upgrade(path)
            on_shard()
        if n_upgraded:
            write_descriptions(folder)
    return n_upgraded


def _upgrade(path: Path) -> bool:
    """Whether a shard was converted; not if it is of today's schema, or damaged."""
    try:
        reader = ShardReader(path)
        if reader.is_current:
            return False
        upgrade_shard(path)
    except InputFileError:
        return False  # `verify_folder` says what is wrong with it
    return True


def upgrade_shard(path: Path) -> None:
    """Writes a shard in today's schema under its name. Its samples and their checksums stay the same.

    Raises:
        InputFileError: A sample is damaged. The file stays as it is.
        UsageError: The shard cannot be written. The old file stays.
    """
    reader = ShardReader(path)
    layers = [name for name in reader.header.layers if name in (IMAGE, *LAYERS)]
    writer = ShardWriter(reader.header.layers, is_plain=reader.is_plain)
    for index, checksum in enumerate(reader.column("checksum").tolist()):
        stored = reader.stored(index, layers, is_checked=True, is_whole=True)
        sample = replace(reader.read(index, ()), image_bytes=stored.pop(IMAGE, None), layers=stored)
        if writer.add(sample) != checksum:
            raise InputFileError(
                f"{path}: expected sample {sample.sample_id!r} to stay the same in schema 3, found other content; "
                "the file stays as it is"
            )
    writer.write(path, reader.header)
