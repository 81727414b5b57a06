"""The job: coefficients in, a folder of shards out.

One unit of work is one shard. Units go to any ``concurrent.futures.Executor``; what a unit writes depends on its
number, the seed and the names of its samples alone, so neither the number of workers nor their order matters. A shard
that is there and was made by the same configuration is not made again.
"""

import json
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, final

import numpy as np

from datagen.gl_context import create_gl_context
from datagen.sources import FaceSource, open_source
from datagen.triplets import TripletMaker
from pix2face import __version__
from pix2face.coefficients import configuration_to_json
from pix2face.errors import SampleRejectedError, UsageError
from pix2face.layers import DEFAULT_LAYERS
from pix2face.morphable_model import MorphableModel, open_model
from pix2face.shard_writing import write_shard
from pix2face.shards import ShardHeader, ShardReader, Triplet

REJECTED_FILE = "rejected.jsonl"


@final
@dataclass(frozen=True)
class RenderJob:
    """What determines the content of the shards.

    Attributes:
        coefficients: A folder of 300W-LP files, or a table.
        model: ``builtin`` or the path of a model file.
        seed: Of everything random in rendered pictures.
        shard_size: Samples in a shard.
    """

    coefficients: Path
    model: str
    seed: int
    shard_size: int


@final
@dataclass(frozen=True)
class JobSummary:
    """What a job did.

    Attributes:
        n_triplets: Triplets in the folder, those of earlier runs included.
        rejected: Samples that could not be used, in the order of the source: id and reason.
        n_shards: Shards in the folder.
        n_shards_kept: Of these, how many were there already.
    """

    n_triplets: int
    rejected: tuple[tuple[str, str], ...]
    n_shards: int
    n_shards_kept: int


def run_job(job: RenderJob, out: Path, executor: Executor, on_progress: Callable[[int], None]) -> JobSummary:
    """Makes every shard that is missing.

    Args:
        job: What to make.
        out: The folder of the shards.
        executor: Where units run; its workers see the same file system.
        on_progress: Called with the number of samples that have just been finished.

    Raises:
        UsageError: The folder holds shards of another configuration, or a worker died.
    """
    model = open_model(job.model)
    source = open_source(job.coefficients, model)
    units = list(range(-(-len(source.sample_ids) // job.shard_size)))
    _check_folder(out, len(units), shard_header(job, source, model, ()))
    missing = [unit for unit in units if not shard_path(out, unit).exists()]
    on_progress(sum(_unit_size(job, source, unit) for unit in units if unit not in set(missing)))
    futures = {executor.submit(render_unit, job, out, unit): unit for unit in missing}
    try:
        for future in as_completed(futures):
            future.result()
            on_progress(_unit_size(job, source, futures[future]))
    except BrokenProcessPool as error:
        raise UsageError(
            f"a worker died (out of memory?); finished shards in {out} are kept: run the same command again, "
            "perhaps with fewer --workers"
        ) from error
    finally:
        for future in futures:
            future.cancel()
    return _summarise(out, units, len(units) - len(missing))


def render_unit(job: RenderJob, out: Path, unit: int) -> None:
    """Makes one shard: what a worker runs."""
    model, source, maker = _worker_state(job)
    triplets: list[Triplet] = []
    rejected: list[tuple[str, str]] = []
    start = unit * job.shard_size
    for index in range(start, start + _unit_size(job, source, unit)):
        try:
            triplets.append(maker.make(source.face(index)))
        except SampleRejectedError as error:
            rejected.append((source.sample_ids[index], str(error)))
    write_shard(shard_path(out, unit), shard_header(job, source, model, tuple(rejected)), triplets)


def shard_path(out: Path, unit: int) -> Path:
    """Where the shard of a unit goes. Its name holds a number and nothing that came from a file."""
    return out / f"shard-{unit:05d}.h5"


def shard_header(
    job: RenderJob, source: FaceSource, model: MorphableModel, rejected: tuple[tuple[str, str], ...]
) -> ShardHeader:
    """What holds for every sample of a shard of this job.

    Args:
        job: The job.
        source: Where its faces come from.
        model: Their model.
        rejected: Samples of this unit that could not be used: id and reason of each.
    """
    configuration = {
        "coefficients": job.coefficients.name,
        "coefficients_sha256": source.sha256,
        "n_faces": len(source.sample_ids),
        "seed": job.seed,
        "shard_size": job.shard_size,
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
        layers=(*DEFAULT_LAYERS, "depth"),
        region_names=model.region_names,
    )


@lru_cache(maxsize=1)
def _worker_state(job: RenderJob) -> tuple[MorphableModel, FaceSource, TripletMaker]:
    """What a worker keeps between units: opening it takes longer than rendering a sample."""
    model = open_model(job.model)
    return model, open_source(job.coefficients, model), TripletMaker(model, create_gl_context(), job.seed)


def _unit_size(job: RenderJob, source: FaceSource, unit: int) -> int:
    return min(job.shard_size, len(source.sample_ids) - unit * job.shard_size)


def _check_folder(out: Path, n_units: int, expected: ShardHeader) -> None:
    """Refuses a folder whose shards another configuration made: mixing them would go unnoticed."""
    for path in sorted(out.glob("shard-*.h5")):
        with ShardReader(path) as reader:
            found = reader.header
        different = _differences(_origin(found), _origin(expected))
        if different:
            raise UsageError(
                f"{path} was made by another configuration ({'; '.join(different)}); delete it or choose another --out"
            )
    surplus = [
        path for path in out.glob("shard-*.h5") if path not in {shard_path(out, unit) for unit in range(n_units)}
    ]
    if surplus:
        raise UsageError(
            f"{surplus[0]} does not belong to this job, whose last shard is {shard_path(out, n_units - 1).name}; "
            "delete it or choose another --out"
        )


def _origin(header: ShardHeader) -> dict[str, Any]:
    """What the shards of one job agree in, by name."""
    try:
        configuration = json.loads(header.configuration)
    except ValueError:
        configuration = header.configuration
    if not isinstance(configuration, dict):
        configuration = {"configuration": configuration}
    return {"model_sha256": header.model_sha256, "generator": header.generator, **configuration}


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


def _summarise(out: Path, units: list[int], n_kept: int) -> JobSummary:
    """Counts what is in the folder, and writes the list of rejected samples beside it."""
    n_triplets, rejected = 0, []
    for unit in units:
        with ShardReader(shard_path(out, unit)) as reader:
            n_triplets += len(reader)
            rejected += [(sample_id, reason) for sample_id, reason in json.loads(reader.header.rejected)]
    lines = (json.dumps({"sample_id": sample_id, "reason": reason}) for sample_id, reason in rejected)
    (out / REJECTED_FILE).write_text("".join(f"{line}\n" for line in lines))
    return JobSummary(n_triplets, tuple(rejected), len(units), n_kept)
