"""Checks of shards that were written some time ago: what a full reading can tell."""

import math
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import final

import numpy as np
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.json_text import Count, parse_json
from pix2face.files.opening import UNFOLDED_RATIO
from pix2face.geometry.maps import face_box
from pix2face.shards.layers import IMAGE, LANDMARKS, LAYERS, SEEN_REGIONS, WHOLE_PICTURE_LAYERS, from_stored
from pix2face.shards.sample import MASK
from pix2face.shards.sample_truth import doubts_about
from pix2face.shards.shard_layout import CONTENT_COLUMNS, content_checksum
from pix2face.shards.shard_reader import ShardHeader, ShardReader, shard_paths

# A normal is rounded to steps in each coordinate.
LARGEST_NORMAL_ERROR = 2 / LAYERS["normals"].steps_per_unit
# Layers are checked whole: each is one compressed chunk, in which the upper bytes of all pixels follow the lower ones.
# A sample of this size with all layers takes 1.6 GB; larger ones are checked where the size of the file supports them.
LARGEST_CHECKED_PX = 1 << 24
SHARD_NUMBER = re.compile(r"shard-(\d+)\.h5")


@final
@dataclass(frozen=True)
class _Job:
    """The part of a rendering job's configuration that says how many shards there are."""

    n_faces: Count
    shard_size: Count


@final
@dataclass(frozen=True)
class FolderReport:
    """What is wrong with a folder of shards."""

    problems: tuple[str, ...]  # in words, one for each
    damaged: tuple[Path, ...]  # shards to delete, so that rendering writes them anew
    doubtful: tuple[str, ...]  # in words, samples whose bytes are intact and whose ground truth cannot be true
    n_samples: int  # samples of the shards without problems
    n_old: int  # shards of an earlier schema among those without problems


def verify_folder(folder: Path, on_shard: Callable[[], None] = lambda: None) -> FolderReport:
    """Reads every shard of a folder, and checks what they are together; ``on_shard`` is called after each.

    Raises:
        UsageError: There is no shard.
        InputFileError: As `verify_shard`.
    """
    problems: list[str] = []
    damaged: list[Path] = []
    doubtful: list[str] = []
    shard_of: dict[str, str] = {}
    headers = {}
    n_old = 0
    for path in shard_paths(folder):
        found = verify_shard(path)
        if not found:
            reader = ShardReader(path)
            headers[path] = reader.header
            n_old += not reader.is_current
            twice = sorted({name for name in reader.sample_ids if name in shard_of})
            found += [f"id {name!r} occurs twice, first in {shard_of[name]}" for name in twice]
            shard_of |= dict.fromkeys(reader.sample_ids, path.name)
        if not found:
            doubtful += [f"{path.name}: {text}" for text in _doubtful_samples(path)]
        if found:
            damaged.append(path)
            problems += [text if str(path) in text else f"{path.name}: {text}" for text in found]
        on_shard()
    problems += _differences(headers)
    problems += _missing(folder, list(headers.values()))
    return FolderReport(tuple(problems), tuple(damaged), tuple(doubtful), len(shard_of), n_old)


def verify_shard(path: Path) -> list[str]:
    """Reads every sample of a shard and checks it.

    Returns:
        What is wrong with it, in words; empty where nothing is.

    Raises:
        InputFileError: A sample declares far larger layers than the file can be expected to hold.
    """
    problems: list[str] = []
    try:
        reader = ShardReader(path)
        sample_ids = reader.sample_ids
        limits_mm = reader.column("offset_limit_mm")
    except InputFileError as error:
        return [str(error)]
    _check_sizes(reader)
    if len(set(sample_ids)) < len(sample_ids):
        problems.append("sample ids are not unique")
    for index, sample_id in enumerate(sample_ids):
        try:
            found = _sample_problems(reader, index, float(limits_mm[index]))
        except InputFileError as error:  # it does not hide what is wrong with other samples
            found = [str(error)]
        problems += [f"sample {sample_id!r}: {text}" for text in found]
    return problems


def _check_sizes(reader: ShardReader) -> None:
    pixel_bytes = sum(
        LAYERS[name].n_channels * LAYERS[name].stored.itemsize for name in reader.header.layers if name in LAYERS
    )
    supported_px = UNFOLDED_RATIO * reader.path.stat().st_size // max(1, pixel_bytes)
    height, width = max(map(reader.size_px, range(len(reader))), key=math.prod, default=(0, 0))
    if height * width > max(LARGEST_CHECKED_PX, supported_px):
        raise InputFileError(
            f"{reader.path}: expected samples of at most {LARGEST_CHECKED_PX >> 20} megapixels, found one of "
            f"{width} x {height} pixels, which is more than a file of this size can be checked for; is it damaged?"
        )


def _doubtful_samples(path: Path) -> list[str]:
    reader = ShardReader(path)
    layers = {IMAGE} & {*reader.header.layers}
    return [
        f"sample {sample.sample_id!r}: {doubt}"
        for index in range(len(reader))
        for sample in [reader.read(index, layers)]
        for doubt in doubts_about(sample, reader.size_px(index))
    ]


def _sample_problems(reader: ShardReader, index: int, offset_limit_mm: float) -> list[str]:
    content = [name for name in reader.header.layers if name != LANDMARKS]
    sample = reader.read(index, {*content[:2], IMAGE} & {*content})
    if IMAGE in content:
        sample.image  # noqa: B018 - decodes it, and compares its size with that of a layer
    # Layers are read whole: damage may also lie outside the box that is said to hold all of them.
    stored = reader.stored(index, (*content, *CONTENT_COLUMNS, "attributes", "box_px", "checksum"), is_whole=True)
    layers, size_px = {name: stored[name] for name in content if name in LAYERS}, reader.size_px(index)
    everywhere = slice(0, size_px[0]), slice(0, size_px[1])
    problems = []
    if stored["checksum"] != content_checksum(stored, dict.fromkeys(layers, everywhere), size_px):
        problems.append("the checksum differs: the content has changed since it was written")
    if MASK in layers:
        top, left, bottom, right = stored["box_px"].tolist()
        problems += _mask_problems(layers, (top, left, bottom, right))
    problems += _range_problems(reader, layers)
    largest = np.abs(layers["offset"].astype(np.int32)).max(initial=0) if "offset" in layers else 0
    if abs(largest / LAYERS["offset"].steps_per_unit - offset_limit_mm) > 1e-3:
        problems.append("offset_limit_mm is not the largest offset")
    arrays = ("identity", "expression", "landmarks2d", "landmarks3d")
    return problems + [f"{name} is not finite" for name in arrays if not np.isfinite(stored[name]).all()]


def _mask_problems(layers: dict[str, ndarray], box_px: tuple[int, int, int, int]) -> list[str]:
    mask, problems = layers["mask"].astype(bool), []
    if layers["mask"].max(initial=0) > 1:
        problems.append("the mask holds more than 0 and 1")
    if not mask.any():
        problems.append("the mask is empty")
    rows, columns = face_box(mask)
    if box_px != (rows.start, columns.start, rows.stop, columns.stop):
        problems.append(f"box_px {box_px} is not the mask's bounding box")
    within = [name for name in layers if name not in WHOLE_PICTURE_LAYERS]
    problems += [f"{name} is not 0 outside the mask" for name in within if layers[name][~mask].any()]
    if "pncc" in layers and not layers["pncc"][mask].any(axis=-1).all():
        problems.append("pncc is 0 within the mask, where no point of a face is")
    if "regions" in layers and not layers["regions"][mask].all():
        problems.append("regions is background within the mask")
    if "normals" in layers:
        lengths = np.linalg.norm(from_stored(LAYERS["normals"], layers["normals"][mask]), axis=-1)
        if not np.abs(lengths - 1).max(initial=0) <= LARGEST_NORMAL_ERROR:
            problems.append("normals are not of unit length within the mask")
    return problems


def _range_problems(reader: ShardReader, layers: dict[str, ndarray]) -> list[str]:
    problems, header = [], reader.header
    if "pncc" in layers:
        largest = np.abs(layers["pncc"].astype(np.int32)).max(initial=0) / LAYERS["pncc"].steps_per_unit
        if not largest <= header.pncc_limit_mm + 1 / LAYERS["pncc"].steps_per_unit:
            problems.append(f"pncc reaches {largest:.1f} mm, beyond the model's {header.pncc_limit_mm:.1f} mm")
    return problems + [
        f"{name} counts to {layers[name].max()}, the header names {len(header.region_names)}"
        for name in ("regions", SEEN_REGIONS)
        if name in layers and layers[name].max(initial=0) > len(header.region_names)
    ]


def _differences(headers: dict[Path, ShardHeader]) -> list[str]:
    """Shards of one folder come from one job: only what was rejected differs."""
    problems = []
    for path, header in headers.items():
        first_path, first = next(iter(headers.items()))
        names = [name for name in header.__dataclass_fields__ if name != "rejected"]
        different = [name for name in names if getattr(header, name) != getattr(first, name)]
        if different:
            problems.append(f"{path.name}: other than in {first_path.name}: {', '.join(different)}; of another job?")
    return problems


def _missing(folder: Path, headers: Sequence[ShardHeader]) -> list[str]:
    """Numbers without a shard: gaps, and what the job's configuration says should follow."""
    numbers = {int(found[1]) for path in shard_paths(folder) if (found := SHARD_NUMBER.fullmatch(path.name))}
    expected = max(numbers, default=-1) + 1
    for header in headers[:1]:
        with suppress(ValueError):  # not made by a rendering job: no more is known than what is there
            job: _Job = parse_json(header.configuration, _Job)
            expected = max(expected, -(-job.n_faces // job.shard_size))
    n_missing = expected - len(numbers)
    named = ", ".join(
        f"shard-{number:05d}.h5" for number in islice((n for n in count() if n not in numbers), min(5, n_missing))
    )
    return [f"{n_missing} missing: {named}{', ...' if n_missing > 5 else ''}"] if n_missing else []
