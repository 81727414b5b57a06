"""One unit of work: a worker reads, renders, packs and writes the faces of one shard.

The content depends on the unit's number, the seed and the names of its samples alone. So neither the number of workers
nor their order matters, and a unit that is tried again writes the same bytes.
"""

import os
import resource
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import cv2
from threadpoolctl import threadpool_limits

from datagen.faces.sources import FaceSource, open_source
from datagen.jobs.folder_lock import worker_lock
from datagen.jobs.render_job import RenderJob, shard_header, shard_path
from datagen.opengl.gl_context import GLContext, GLSettings
from datagen.opengl.rasteriser_choice import open_context
from datagen.process_pool import limit_threads, report
from datagen.samples.baked_jitter import View, ViewMaker
from datagen.samples.sample_making import SampleMaker
from datagen.samples.stage_times import StageTimes
from pix2face.errors import InputFileError, SampleRejectedError, UsageError
from pix2face.models.morphable_model import MorphableModel, open_model
from pix2face.shards.shard_writing import ShardWriter

# The vertices of at most so many views come from one matrix product: it reads the basis once for all of them (with two
# workers on an old processor, a face of BFM's size takes 3.7 ms of 50, and 2.9 of 100), and they take 82 MB.
VIEWS_AT_A_TIME = 128


@final
@dataclass(frozen=True)
class Unit:
    """A shard to be made."""

    job: RenderJob
    number: int
    out: Path  # the folder of the shards
    gl: GLSettings  # the OpenGL to draw with
    source_sha256: str  # hash of the faces that the job saw; a worker that saw others would mix them
    model_sha256: str  # hash of the model that the job saw


@final
@dataclass(frozen=True)
class UnitReport:
    """What a unit cost."""

    n_faces: int  # faces that were tried
    cpu_seconds: Mapping[str, float]  # by stage
    peak_memory_bytes: int  # the largest memory of the worker so far


def render_unit(unit: Unit) -> UnitReport:
    """Makes one shard.

    Raises:
        UsageError: The worker sees another model or other faces than the job, or cannot write the shard.
        GLUnavailableError: The worker cannot draw.
    """
    return _DRAWING_THREAD.submit(_render_unit, unit).result()


@final
@dataclass(frozen=True, eq=False)
class _Worker:
    """What a worker keeps between units, because opening it takes longer than rendering a sample."""

    model: MorphableModel
    source: FaceSource
    gl: GLContext | None
    views: ViewMaker
    maker: SampleMaker


# A context of OpenGL belongs to one thread; the workers of a cluster may call from several.
_DRAWING_THREAD = ThreadPoolExecutor(1, thread_name_prefix="drawing")
# The worker of this process, by its job; of that thread.
_KEPT: dict[Unit, _Worker] = {}


def _render_unit(unit: Unit) -> UnitReport:
    times = StageTimes()
    if not unit.out.is_dir():
        raise UsageError(f"{unit.out}: expected the worker to see the folder of the shards, found that it does not")
    with worker_lock(unit.out), threadpool_limits(1, user_api="blas"):
        with times.stage("open model and source"):
            worker = _worker(unit)
        order = {name: place for place, name in enumerate(unit.job.sample_ids_of(worker.source, unit.number))}
        rejected: list[tuple[str, str]] = []
        writer = ShardWriter(unit.job.layers, is_plain=unit.job.is_plain)
        _add_samples(writer, unit, worker, rejected, times)
        rejected.sort(key=lambda entry: order[entry[0]])
        with times.stage("write, check"):
            header = shard_header(unit.job, worker.source, worker.model, _without_place(unit.job, rejected))
            writer.write(shard_path(unit.out, unit.number), header)
    n_faces = len(unit.job.faces_of(worker.source, unit.number))
    return UnitReport(n_faces, times.cpu_seconds, _peak_memory_bytes())


def _add_samples(
    writer: ShardWriter, unit: Unit, worker: _Worker, rejected: list[tuple[str, str]], times: StageTimes
) -> None:
    """Makes the samples of a unit in the order of the source; those that cannot be used are added to ``rejected``."""
    n_variants, n_done = max(unit.job.jitter.n, 1), 0
    most_faces = max(VIEWS_AT_A_TIME // n_variants, 1)
    for indices in _even_parts(unit.job.faces_of(worker.source, unit.number), most_faces):
        with times.stage("read coefficients"):
            views = _views(unit.job, worker, indices, rejected)
        for view, made in zip(views, worker.maker.make_all(views, times, in_steps=True), strict=True):
            sample_id, n_done = view.face.sample_id, n_done + 1
            report(unit.number, n_done // n_variants)
            if isinstance(made, SampleRejectedError):
                rejected.append((sample_id, str(made)))
                continue
            try:
                with times.stage("encode"):
                    writer.add(made)
            except InputFileError as error:  # a value that the format cannot hold would cost the whole shard
                rejected.append((sample_id, f"{sample_id}: {error}"))


def _without_place(job: RenderJob, rejected: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """The rejected samples with paths relative to the folder of the faces, which a shard does not name."""
    folder = job.coefficients if job.coefficients.is_dir() else job.coefficients.parent
    return [(sample_id, reason.replace(f"{folder}{os.sep}", "")) for sample_id, reason in rejected]


def _even_parts(faces: range, at_most: int) -> Iterator[range]:
    """Splits faces into parts of about the same size, because small matrix products are slow."""
    n_parts = -(-len(faces) // at_most)
    for part in range(n_parts):
        yield faces[part * len(faces) // n_parts : (part + 1) * len(faces) // n_parts]


def _views(job: RenderJob, worker: _Worker, indices: range, rejected: list[tuple[str, str]]) -> list[View]:
    views = []
    for index in indices:
        try:
            views += worker.views.views(worker.source.face(index))
        except SampleRejectedError as error:
            rejected += [(name, str(error)) for name in job.jitter.sample_ids(worker.source.sample_ids[index])]
    return views


def _worker(unit: Unit) -> _Worker:
    key = replace(unit, number=0)
    if key not in _KEPT:
        while _KEPT:
            released = _KEPT.popitem()[1].gl
            if released is not None:
                released.release()
        _KEPT[key] = _open_worker(unit)
    return _KEPT[key]


def _open_worker(unit: Unit) -> _Worker:
    limit_threads()
    cv2.setNumThreads(1)
    job = unit.job
    model = open_model(job.model)
    _check_same("model", job.model, model.sha256, unit.model_sha256)
    source = open_source(job.coefficients, model)
    _check_same("faces", str(job.coefficients), source.sha256, unit.source_sha256)
    gl = open_context(unit.gl, draws_pictures=job.draws_pictures(source))
    views = ViewMaker(model, job.jitter, job.seed)
    return _Worker(model, source, gl, views, SampleMaker(model, gl, job.seed, job.layers, job.appearance))


def _check_same(what: str, place: str, found: str, expected: str) -> None:
    if found != expected:
        raise UsageError(
            f"{place}: expected the worker to see the {what} of the job ({expected[:12]}), found others "
            f"({found[:12]}); do all workers see the same files, and do they stay as they are while the job runs?"
        )


def _peak_memory_bytes() -> int:
    """The largest memory of this process: from /proc where it says so, because getrusage begins with the parent's."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
        kilobytes = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))
    except (OSError, StopIteration):
        kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return kilobytes * 1024
