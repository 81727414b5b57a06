"""Folders of shards as a command line names them: ``a/`` or, with its share of the draws, ``a/:0.7``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

from pix2face.errors import UsageError


@final
@dataclass(frozen=True)
class ShardFolder:
    """A folder of shards."""

    path: Path
    weight: float | None = None  # share of the draws; None draws the samples of all folders equally often


def parse_shard_folders(texts: Sequence[str]) -> list[ShardFolder]:
    """Reads folders with or without weights.

    Raises:
        UsageError: A weight is no number above 0, or some have one and others not.
    """
    folders = [_parse(text) for text in texts]
    without = [folder for folder in folders if folder.weight is None]
    if without and len(without) < len(folders):
        raise UsageError(
            f"--shards: expected a weight for every folder or for none, found none for {without[0].path}; "
            f"write {without[0].path}:0.5 or the like"
        )
    return folders


def _parse(text: str) -> ShardFolder:
    path, colon, weight = text.rpartition(":")
    if not colon or not path or Path(text).exists():
        return ShardFolder(Path(text))
    try:
        value = float(weight)
    except ValueError:
        return ShardFolder(Path(text))  # a colon in the name of a folder
    if not 0 < value < math.inf:
        raise UsageError(f"--shards {text}: expected a weight above 0, found {weight}")
    return ShardFolder(Path(path), value)
