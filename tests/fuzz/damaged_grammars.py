"""Files of models, shards and tables that are damaged at random: bytes flipped or overwritten, or the end cut off."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from pix2face.face_files.coefficients import load_coefficients
from pix2face.model_formats import read_model
from pix2face.models.model_file import write_stored_model
from pix2face.models.morphable_model import load_model
from tests.fuzz.array_grammars import originals
from tests.fuzz.grammar import Grammar
from tests.fuzz.shard_originals import read_shard, write_small_shard, write_table
from tests.fuzz.values import Rng, one
from tests.model_files import stored_small_head
from tests.published_models import (
    tiny_solid,
    write_bfm,
    write_flame,
    write_gnm,
    write_guo,
    write_ict,
    write_original_bfm,
    write_statismo,
    write_surrey,
)

EXTREME_BYTES = (0x00, 0x01, 0x7F, 0x80, 0xFF)
KEYPOINTS = np.arange(68) % 6


def damaged(content: bytes, rng: Rng) -> bytes:
    """One random way to damage a file."""
    data = bytearray(content)
    kind = rng.integers(4)
    if kind in (0, 3):
        # Headers decide most: half of the cuts and flips aim at the first kilobyte.
        reach = len(data) if rng.random() < 0.5 else min(len(data), 1024)
        for _ in range(int(rng.integers(1, 9))):
            data[int(rng.integers(reach))] ^= int(rng.integers(1, 256))
    if kind in (1, 3):
        start = int(rng.integers(len(data)))
        length = int(rng.choice([1, 2, 4, 8]))
        data[start : start + length] = bytes([int(rng.choice(EXTREME_BYTES))]) * len(data[start : start + length])
    if kind in (2, 3):
        del data[int(rng.integers(len(data) + 1)) :]
    return bytes(data)


def damaged_of(
    write: Callable[[Path], object], opened: str = ".", read: Callable[[Path], object] = read_model
) -> Grammar:
    """A grammar of folders in which one file is damaged, or none of a tenth.

    Args:
        write: Fills an empty folder.
        opened: What the reader is given, relative to the folder.
        read: The reader.
    """

    def draw(folder: Path, rng: Rng) -> None:
        files = originals(write)
        chosen = one(rng, sorted(files)) if rng.random() < 0.9 else ""
        for name, content in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(damaged(content, rng) if name == chosen else content)

    return Grammar(draw, lambda folder: read(folder / opened), "")


def _shard(kind: str) -> Grammar:
    return damaged_of(partial(write_small_shard, kind=kind), "shard-00000.h5", read_shard)


def _original_bfm(folder: Path) -> None:
    write_original_bfm(folder, tiny_solid())
    write_guo(folder, 0 * tiny_solid().mean, tiny_solid().expression)


def _statismo(folder: Path) -> None:
    landmarks = '[{"id": "center.nose.tip", "coordinates": [80, 0, 0]}]'
    write_statismo(folder / "a.h5", tiny_solid(), landmarks=landmarks, unit_m=0.001)


DAMAGED_GRAMMARS = {
    "damaged bfm2009": damaged_of(lambda folder: write_bfm(folder, tiny_solid(), KEYPOINTS)),
    "damaged bfm2009-compressed": damaged_of(
        lambda folder: write_bfm(folder, tiny_solid(), KEYPOINTS, compressed=True)
    ),
    "damaged bfm2009-original": damaged_of(_original_bfm),
    "damaged statismo": damaged_of(_statismo, "a.h5"),
    "damaged flame": damaged_of(lambda folder: write_flame(folder / "a.pkl", tiny_solid()), "a.pkl"),
    "damaged flame-protocol-0": damaged_of(
        lambda folder: write_flame(folder / "a.pkl", tiny_solid(), protocol=0), "a.pkl"
    ),
    "damaged surrey": damaged_of(lambda folder: write_surrey(folder, tiny_solid(), colour=True), "model.bin"),
    "damaged ict_facekit": damaged_of(lambda folder: write_ict(folder, tiny_solid())),
    "damaged gnm": damaged_of(lambda folder: write_gnm(folder / "a.npz", tiny_solid()), "a.npz"),
    "damaged gnm-compressed": damaged_of(
        lambda folder: write_gnm(folder / "a.npz", tiny_solid(), compressed=True), "a.npz"
    ),
    "damaged model": damaged_of(
        lambda folder: write_stored_model(stored_small_head(), folder / "a.h5"), "a.h5", load_model
    ),
    "damaged shard": _shard("coded"),
    "damaged shard-plain": _shard("plain"),
    "damaged shard-2": _shard("old-deflate"),
    "damaged shard-2-plain": _shard("old-plain"),
    "damaged shard-2-zstd": _shard("old-zstd"),
    "damaged table": damaged_of(write_table, "faces.h5", load_coefficients),
}
