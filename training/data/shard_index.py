"""An index of the samples in several folders of shards, made once before training."""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Int32, Int64, UInt64
from numpy import ndarray

from pix2face.command_line import counted
from pix2face.errors import ModelMismatchError, UsageError
from pix2face.shards.layers import DEFAULT_LAYERS
from pix2face.shards.sample import check_has_layers
from pix2face.shards.sample_filter import SampleFilter
from pix2face.shards.shard_reader import ShardHeader, ShardReader, shard_paths
from training.data.persons import PersonGroups
from training.data.shard_folders import ShardFolder

OFFSET_SCALE_STEP_MM = 5.0
SEEN = "seen"


@final
@dataclass(frozen=True, eq=False)
class SampleSet:
    """Samples that are drawn equally often."""

    weight: float  # share of the draws that they get together
    samples: Int64[ndarray, " n"]  # their numbers


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class ShardIndex:
    """All samples of a training."""

    readers: tuple[ShardReader, ...]
    shard: Int32[ndarray, " n"]  # for each sample the number of its shard
    position: Int32[ndarray, " n"]  # for each sample its place in that shard
    person: UInt64[ndarray, " n"]  # for each sample a hash of the person
    sets: tuple[SampleSet, ...]  # the samples that are drawn; others are held out, or left out by `where`
    n_samples: int  # of all shards, drawn or not
    where: str  # the condition that the attributes of a drawn sample fulfil; empty for none
    held_out: float = 0.0  # share of the persons that `split_off` held out
    n_held_out: int = 0  # number of their samples
    model_name: str  # the one morphable model of all shards
    model_sha256: str
    smallest_radius_mm: float  # distance from the origin to the nearest point of the mean face
    pncc_scale_mm: float  # PNCC divided by this is within ±1
    offset_scale_mm: float  # offsets divided by this are within ±1
    licence: str  # the terms of all shards
    mirror_obstacle: str  # why samples cannot be mirrored; empty where they can
    knows_seen: bool  # whether every shard has the layer seen
    # Hash of all sample ids and stored checksums, in order. It differs also where the same ids were rendered with
    # another seed.
    samples_sha256: str

    def __len__(self) -> int:
        """Samples that are drawn."""
        return sum(len(found.samples) for found in self.sets)

    @property
    def description(self) -> str:
        """How many of the samples are drawn, and why the others are not."""
        found = f"{len(self)} in {counted(len(self.readers), 'shard')}"
        if len(self) == self.n_samples:
            return found
        n_passing = len(self) + self.n_held_out
        notes = [f"{n_passing} of {self.n_samples} where {self.where}"] if self.where else []
        notes += [f"{self.n_held_out} held out"] if self.n_held_out else []
        return f"{found} ({', '.join(notes)})"

    @property
    def samples(self) -> Int64[ndarray, " n"]:
        """The numbers of those that are drawn, of all sets."""
        return np.concatenate([found.samples for found in self.sets])

    def configuration(self) -> dict[str, Any]:
        """The facts about the data on which the weights of a training depend."""
        return {
            "samples": len(self),
            "samples_sha256": self.samples_sha256,
            "model_sha256": self.model_sha256,
            "pncc_scale_mm": self.pncc_scale_mm,
            "offset_scale_mm": self.offset_scale_mm,
            "mixture": [found.weight for found in self.sets],
            "where": self.where,
            "validation": self.held_out,
        }


def index_shards(
    folders: Sequence[Path | ShardFolder], where: str = "", layers: Sequence[str] = DEFAULT_LAYERS
) -> ShardIndex:
    """Opens every shard once and makes an index of the samples.

    Args:
        folders: Folders with a weight are sets of their own; folders without are one set together.
        where: A condition on the attributes of samples (``pix2face.shards.sample_filter``); empty takes all.
        layers: Names of the layers that every shard must have.

    Raises:
        UsageError: A folder has no shards, a shard lacks a layer that is trained on, or there is no sample to draw.
        InputFileError: A shard is truncated, foreign or of a newer schema.
        ModelMismatchError: The shards are of different morphable models.
    """
    chosen = SampleFilter(where, "--where") if where.strip() else None
    persons = PersonGroups()
    named = [folder if isinstance(folder, ShardFolder) else ShardFolder(folder) for folder in folders]
    paths = [[*shard_paths(folder.path)] for folder in named]
    found = [_read_facts(path, persons, chosen, layers) for path in chain.from_iterable(paths)]
    if not found:
        raise UsageError("--shards: expected one folder of shards or more, found none")
    _check_same_model(found)
    counts = [len(facts.passes) for facts in found]
    if not sum(counts):
        listed = ", ".join(str(folder.path) for folder in named)
        raise UsageError(f"{listed}: expected samples to train on, found empty shards alone")
    if chosen is not None:
        chosen.check_names()
    limit_mm = max(facts.offset_limit_mm for facts in found)
    return ShardIndex(
        readers=tuple(facts.reader for facts in found),
        shard=np.repeat(np.arange(len(counts), dtype=np.int32), counts),
        position=np.concatenate([np.arange(count, dtype=np.int32) for count in counts]),
        person=persons.hashes(),
        sets=_sets(named, [len(group) for group in paths], found),
        n_samples=sum(counts),
        where=where.strip(),
        samples_sha256=hashlib.sha256(b"".join(facts.digest for facts in found)).hexdigest(),
        offset_scale_mm=max(math.ceil(limit_mm / OFFSET_SCALE_STEP_MM), 1) * OFFSET_SCALE_STEP_MM,
        **_common([facts.reader.header for facts in found]),
    )


def split_off(index: ShardIndex, fraction: float) -> tuple[ShardIndex, ShardIndex]:
    """Divides the samples into those to train on and those to validate with, by persons: nobody is in both.

    About the given fraction of the persons is held out. Whether a person is held out depends on that person alone, not
    on a seed, the order of shards, or other persons.

    Raises:
        UsageError: One of the two parts would be empty.
    """
    is_held_out = index.person < np.uint64(int(fraction * 2**64))
    parts = []
    for chosen, what in ((~is_held_out, "to train on"), (is_held_out, "to validate with")):
        sets = tuple(replace(found, samples=found.samples[chosen[found.samples]]) for found in index.sets)
        if not all(len(found.samples) for found in sets):
            n_persons = len(np.unique(index.person[index.samples]))
            raise UsageError(
                f"--validation {fraction:g}: expected samples {what} in each set of shards, found none among "
                f"{counted(n_persons, 'person')}; give another share, more shards, or 0 to validate with none"
            )
        parts.append(replace(index, sets=sets, held_out=fraction, n_held_out=int(is_held_out[index.samples].sum())))
    return parts[0], parts[1]


@final
@dataclass(frozen=True, eq=False)
class _ShardFacts:
    """Facts about one shard; ``passes`` says for each sample whether it is chosen."""

    reader: ShardReader
    passes: list[bool]
    offset_limit_mm: float
    digest: bytes


def _read_facts(path: Path, persons: PersonGroups, chosen: SampleFilter | None, layers: Sequence[str]) -> _ShardFacts:
    reader = ShardReader(path)
    check_has_layers(reader.header.layers, layers, str(path))
    sample_ids, passes = reader.sample_ids, []
    for sample_id, identity, attributes in zip(sample_ids, reader.column("identity"), reader.attributes(), strict=True):
        persons.add(sample_id, identity, attributes)
        passes.append(chosen is None or chosen.passes(sample_id, attributes))
    content = json.dumps([sample_ids, [f"{value:08x}" for value in reader.column("checksum").tolist()]]).encode()
    limit_mm = float(reader.column("offset_limit_mm").max(initial=0))
    return _ShardFacts(reader, passes, limit_mm, hashlib.sha256(content).digest())


def _sets(
    folders: Sequence[ShardFolder], shards_of_folder: Sequence[int], found: Sequence[_ShardFacts]
) -> tuple[SampleSet, ...]:
    """One set for each folder with a weight; one of all where they have none."""
    ends = np.cumsum([len(facts.passes) for facts in found])
    shard_ends = np.cumsum(shards_of_folder)
    passes = np.array([value for facts in found for value in facts.passes], dtype=bool)
    passing = np.flatnonzero(passes).astype(np.int64)
    is_weighted = folders[0].weight is not None
    first_of_next = ends[shard_ends[:-1] - 1]
    groups = np.split(passing, np.searchsorted(passing, first_of_next)) if is_weighted else [passing]
    total = math.fsum(folder.weight or 1.0 for folder in folders)
    weights = [(folder.weight or 1.0) / total for folder in folders] if is_weighted else [1.0]
    for folder, group in zip(folders, groups, strict=False):
        if not len(group):
            raise UsageError(
                f"{folder.path}: expected samples that --where lets pass, found none of {len(passes)}; "
                "`datagen stats --all` lists the attributes and their values"
            )
    return tuple(SampleSet(weight, group) for weight, group in zip(weights, groups, strict=True))


def _common(headers: Sequence[ShardHeader]) -> dict[str, Any]:
    return {
        "model_name": headers[0].model_name,
        "model_sha256": headers[0].model_sha256,
        "smallest_radius_mm": headers[0].smallest_radius_mm,
        "pncc_scale_mm": max(header.pncc_limit_mm for header in headers),
        "licence": "; ".join(sorted({header.licence for header in headers})),
        "mirror_obstacle": next((header.mirror_obstacle for header in headers if header.mirror_obstacle), ""),
        "knows_seen": all(SEEN in header.layers for header in headers),
    }


def _check_same_model(found: Sequence[_ShardFacts]) -> None:
    first = found[0].reader
    for other in (facts.reader for facts in found):
        if other.header.model_sha256 != first.header.model_sha256:
            a, b = (f"{own.header.model_name!r} ({own.header.model_sha256[:12]})" for own in (other, first))
            raise ModelMismatchError(
                f"{other.path} is of the morphable model {a}, {first.path} of {b}; train on shards of one model"
            )
