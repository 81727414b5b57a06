"""What a job makes: which samples go into which shard, and what every shard says of the job.

What decides the content of the shards is in ``RenderJob`` and is compared when a folder is completed. What does not
(how many workers, which device, whose cluster) is not.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from datagen.appearance.appearance_config import PLAIN, PRESETS, AppearanceConfig
from datagen.appearance.scene import SCENE_REGIONS
from datagen.faces.sources import FaceSource
from datagen.samples.baked_jitter import NO_JITTER, JitterBake
from pix2face import __version__
from pix2face.errors import InputFileError, UsageError
from pix2face.face_files.coefficients import configuration_to_json
from pix2face.files.json_text import JsonObject, parse_json
from pix2face.models.mirroring import mirror_obstacle
from pix2face.models.morphable_model import MorphableModel
from pix2face.shards.layers import DEFAULT_LAYERS, IMAGE, SCENE_LAYERS, SEEN_REGIONS
from pix2face.shards.shard_reader import ShardHeader, ShardReader

# How the configuration of a job names what it stores: coded maps, or plain ones. Earlier versions had others.
CODED_MAPS, PLAIN_MAPS = "deflate", "plain"


@final
@dataclass(frozen=True)
class RenderJob:
    """All that determines the content of the shards."""

    coefficients: Path  # a folder of 300W-LP files, or a table
    model: str  # `builtin` or the path of a model file
    seed: int  # seed of everything random in rendered pictures
    shard_size: int  # faces in a shard
    layers: tuple[str, ...] = DEFAULT_LAYERS  # layers of each sample, of `pix2face.shards.layers.LAYER_NAMES`
    jitter: JitterBake = NO_JITTER  # the variants of each sample that take its place
    appearance: AppearanceConfig = PRESETS[PLAIN]  # how faces without a photograph are drawn
    is_plain: bool = False  # whether maps are stored as plain numbers

    def draws_pictures(self, source: FaceSource) -> bool:
        """Whether pictures are drawn of some faces of a source."""
        return source.lacks_photographs and not {IMAGE, *SCENE_LAYERS}.isdisjoint(self.layers)

    def n_units(self, source: FaceSource) -> int:
        """How many shards the faces of a source make."""
        return -(-len(source.sample_ids) // self.shard_size)

    def faces_of(self, source: FaceSource, unit: int) -> range:
        """Which faces of a source go into one shard."""
        start = unit * self.shard_size
        return range(start, min(start + self.shard_size, len(source.sample_ids)))

    def sample_ids_of(self, source: FaceSource, unit: int) -> list[str]:
        """The samples of one shard, rejected ones included, in their order."""
        faces = self.faces_of(source, unit)
        return [name for face in faces for name in self.jitter.sample_ids(source.sample_ids[face])]


def shard_path(out: Path, unit: int) -> Path:
    """The file of a unit's shard. Its name holds a number and nothing that came from a file."""
    return out / f"shard-{unit:05d}.h5"


def shard_header(
    job: RenderJob, source: FaceSource, model: MorphableModel, rejected: Sequence[tuple[str, str]]
) -> ShardHeader:
    """The header of a shard, with id and reason of each of its samples that could not be used."""
    configuration = {
        "coefficients": job.coefficients.name,
        "coefficients_sha256": source.sha256,
        "n_faces": len(source.sample_ids),
        "seed": job.seed,
        "shard_size": job.shard_size,
        "compression": PLAIN_MAPS if job.is_plain else CODED_MAPS,
        **job.jitter.described(),
        **job.appearance.described(),
    }
    return ShardHeader(
        model_name=model.name,
        model_sha256=model.sha256,
        pncc_limit_mm=float(np.abs(model.mean).max()),
        smallest_radius_mm=model.smallest_radius_mm,
        licence=source.licence,
        configuration=configuration_to_json(configuration),
        generator=f"pix2face {__version__}",
        rejected=json.dumps(rejected),
        layers=job.layers,
        region_names=(*model.region_names, *(SCENE_REGIONS if SEEN_REGIONS in job.layers else ())),
        mirror_obstacle=mirror_obstacle(model) or "",
    )


def look_into(
    out: Path, job: RenderJob, source: FaceSource, expected: ShardHeader
) -> tuple[tuple[int, ...], tuple[Path, ...]]:
    """Finds which shards of a job its folder lacks, and which are damaged. The headers of all others must agree.

    Returns:
        The units whose shards have to be made, in order, and the shards that cannot be opened and are replaced.

    Raises:
        UsageError: A shard was made by another configuration, or belongs to no unit of this job. Mixing them would go
            unnoticed.
        InputFileError: A shard is sound, but this version cannot read it.
    """
    n_units = job.n_units(source)
    units = {shard_path(out, unit): unit for unit in range(n_units)}
    damaged = []
    for path in sorted(out.glob("shard-*.h5")):
        if path not in units:
            raise UsageError(
                f"{path} does not belong to this job, whose last shard is {shard_path(out, n_units - 1).name}; "
                "delete it or choose another --out"
            )
        try:
            reader = ShardReader(path)
        except InputFileError as error:
            if not _is_damage(error):
                raise
            damaged.append(path)
            continue
        _check_header(path, reader.header, expected)
        _check_samples(path, reader, job.sample_ids_of(source, units[path]))
    missing = tuple(unit for path, unit in units.items() if path in damaged or not path.exists())
    return missing, tuple(damaged)


def _is_damage(error: InputFileError) -> bool:
    """Whether HDF5 failed to open a readable file, which was cut short or overwritten.

    A shard of another schema, or another program's file, is not damaged, and is never replaced.
    """
    cause = error.__cause__
    return isinstance(cause, OSError) and not isinstance(cause, PermissionError | IsADirectoryError)


def _check_header(path: Path, found: ShardHeader, expected: ShardHeader) -> None:
    different = _differences(_origin(found), _origin(expected))
    if different:
        raise UsageError(
            f"{path} was made by another configuration ({'; '.join(different)}); delete it or choose another --out"
        )


def _check_samples(path: Path, reader: ShardReader, expected: Sequence[str]) -> None:
    """A shard that was copied over another has the right header and the wrong samples."""
    rejected = [sample_id for sample_id, _ in reader.header.rejected_samples]
    surplus = sorted({*reader.sample_ids, *rejected} - set(expected))
    if surplus or len(reader) + len(rejected) != len(expected):
        found = f"sample {surplus[0]!r}" if surplus else f"{len(reader) + len(rejected)} samples"
        raise UsageError(
            f"{path}: expected the {len(expected)} samples from {expected[0]!r} to {expected[-1]!r}, found {found}: "
            "delete it and run the same command again"
        )


def _origin(header: ShardHeader) -> dict[str, Any]:
    """The values that all shards of a job share, by name."""
    return {
        "model_sha256": header.model_sha256,
        "generator": header.generator,
        "layers": ",".join(header.layers),
        **parse_json(header.configuration, JsonObject),
    }


def _differences(found: Mapping[str, Any], expected: Mapping[str, Any]) -> list[str]:
    """Such as "seed 0 -> 3"; hashes are cut to what tells them apart."""
    return [
        f"{name} {_short(found.get(name))} -> {_short(expected.get(name))}"
        for name in sorted(found.keys() | expected.keys())
        if found.get(name) != expected.get(name)
    ]


def _short(value: Any) -> str:
    text = str(value)
    is_hash = len(text) == 64 and set(text) <= set("0123456789abcdef")
    return text[:12] if is_hash else text[:80]
