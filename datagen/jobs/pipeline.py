"""The job: it reads coefficients and writes a folder of shards.

One unit of work is one shard (``render_unit``). A finished shard of the same configuration is not made again, so a job
that was stopped, killed, or ran out of disk goes on where it was. The folder ends up byte for byte as after an
undisturbed run. One job at a time writes to a folder (``folder_lock``).
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

from datagen.appearance.appearance_config import AppearanceConfig
from datagen.faces.sources import FaceSource, open_source
from datagen.inspection.croissant import write_descriptions
from datagen.jobs.executors import WorkPlace
from datagen.jobs.folder_lock import job_lock, remove_unfinished
from datagen.jobs.render_job import RenderJob, look_into, shard_header, shard_path
from datagen.jobs.render_unit import Unit, UnitReport, render_unit
from datagen.jobs.work_units import finish_units
from datagen.opengl.gl_context import GLSettings
from datagen.samples.sample_making import check_appearance
from datagen.samples.stage_times import StageTimes
from pix2face.command_line import REJECTED_FILE, write_rejected
from pix2face.models import BUILTIN_MODEL
from pix2face.models.morphable_model import MorphableModel, open_model
from pix2face.models.surface_attributes import check_layers
from pix2face.shards.shard_reader import ShardReader


@final
@dataclass(frozen=True)
class JobSummary:
    """What a job did."""

    n_triplets: int  # in the folder, including those of earlier runs
    rejected: tuple[tuple[str, str], ...]  # id and reason of each unusable sample, in the order of the source
    n_shards: int  # in the folder
    n_shards_kept: int  # of earlier runs among them
    times: StageTimes = field(default_factory=StageTimes)  # of all workers in this run
    peaks_bytes: tuple[int, ...] = ()  # the largest memory of the worker so far, after each unit of this run


@final
@dataclass(frozen=True, eq=False)
class OpenedJob:
    """A job with its opened model and faces. Listing a large folder takes seconds, and is done once."""

    job: RenderJob  # with absolute paths, because workers of a cluster have other working directories
    model: MorphableModel
    source: FaceSource


def open_job(job: RenderJob) -> OpenedJob:
    """Opens the model and the faces of a job.

    Raises:
        UsageError: The coefficients do not exist, or the model lacks what a layer needs.
        InputFileError: The model or the table cannot be read.
        ModelMismatchError: The table belongs to another model.
    """
    name = job.model if job.model == BUILTIN_MODEL else os.fspath(Path(job.model).absolute())
    job = replace(job, coefficients=job.coefficients.absolute(), model=name)
    model = open_model(job.model)
    check_layers(model, job.layers)
    check_appearance(model, job.layers, job.appearance)
    return OpenedJob(job, model, open_source(job.coefficients, model))


def reopened(opened: OpenedJob, appearance: AppearanceConfig, layers: tuple[str, ...]) -> OpenedJob:
    """The same job with another appearance and other layers, without opening its files again.

    Raises:
        UsageError: The model lacks what they need.
    """
    check_layers(opened.model, layers)
    check_appearance(opened.model, layers, appearance)
    return replace(opened, job=replace(opened.job, appearance=appearance, layers=layers))


@final
@dataclass(frozen=True)
class Listener:
    """Callbacks of a job."""

    on_kept: Callable[[int], None] = lambda n: None  # once: samples that earlier runs have finished
    # Faces that have just been done; fewer than 0 if a worker died and its shard begins again.
    on_progress: Callable[[int], None] = lambda n: None
    on_notice: Callable[[str], None] = lambda text: None  # messages for the user that stop nothing


def run_job(
    opened: OpenedJob, out: Path, place: WorkPlace, gl: GLSettings | None = None, listener: Listener | None = None
) -> JobSummary:
    """Makes every shard that is missing in the folder ``out``. Workers at the place must see the same files.

    Raises:
        UsageError: The folder holds shards of another configuration, another job writes to it, or workers died.
    """
    out, listener = out.absolute(), listener or Listener()
    out.mkdir(parents=True, exist_ok=True)
    with job_lock(out) as warning:
        if warning:
            listener.on_notice(warning)
        if not remove_unfinished(out):
            listener.on_notice(f"{out}: workers of an earlier run still write there; what they leave unfinished stays")
        try:
            return _run(opened, out, place, gl or GLSettings(), listener)
        finally:
            remove_unfinished(out)


@final
class _Progress:
    """Adds up how much of each unit is done."""

    def __init__(self, on_progress: Callable[[int], None]) -> None:
        self._on_progress = on_progress
        self._done: dict[int, int] = {}
        self._finished: set[int] = set()
        self._lock = threading.Lock()

    def report(self, unit: int, n_done: int) -> None:
        with self._lock:  # reports come from another thread than results, and may be late
            if unit not in self._finished:
                self._count(unit, n_done)

    def finish(self, unit: int, n_done: int) -> None:
        with self._lock:
            self._finished.add(unit)
            self._count(unit, n_done)

    def _count(self, unit: int, n_done: int) -> None:
        self._on_progress(n_done - self._done.get(unit, 0))
        self._done[unit] = n_done


def _run(opened: OpenedJob, out: Path, place: WorkPlace, gl: GLSettings, listener: Listener) -> JobSummary:
    job, source, n_units = opened.job, opened.source, opened.job.n_units(opened.source)
    missing, damaged = look_into(out, job, source, shard_header(job, source, opened.model, ()))
    for path in damaged:
        listener.on_notice(f"{path} is cut short or damaged: it is made anew")
    listener.on_kept(len(source.sample_ids) - sum(len(job.faces_of(source, unit)) for unit in missing))
    times, peaks, progress = StageTimes(), list[int](), _Progress(listener.on_progress)

    def submit(executor: Executor, number: int) -> Future[UnitReport]:
        return executor.submit(render_unit, Unit(job, number, out, gl, source.sha256, opened.model.sha256))

    def on_finished(unit: int, report: UnitReport) -> None:
        times.add(report.cpu_seconds)
        peaks.append(report.peak_memory_bytes)
        progress.finish(unit, report.n_faces)

    finish_units(missing, place, submit, on_finished, progress.report)
    n_triplets, rejected = _count(out, n_units)
    write_rejected(out / REJECTED_FILE, rejected)
    write_descriptions(out)
    return JobSummary(n_triplets, tuple(rejected), n_units, n_units - len(missing), times, tuple(peaks))


def _count(out: Path, n_units: int) -> tuple[int, list[tuple[str, str]]]:
    n_triplets, rejected = 0, []
    for unit in range(n_units):
        reader = ShardReader(shard_path(out, unit))
        n_triplets += len(reader)
        rejected += reader.header.rejected_samples
    return n_triplets, rejected
