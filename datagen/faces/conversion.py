"""A folder of coefficient files or annotated photographs becomes one table: in streaming, on any number of processes.

What a face becomes depends on its files and the model alone, and faces are written in the order of the source, so the
table is the same for any number of workers. A face that cannot be used is listed with its reason; the rest is done.
"""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Literal, final

import numpy as np

from datagen.faces.fit_landmark_folder import AnnotatedFolder
from datagen.faces.sources import FaceSource, W300LPFolder, is_text
from datagen.faces.text_files import write_rejected
from pix2face import __version__
from pix2face.errors import SampleRejectedError, UsageError
from pix2face.face_files.coefficient_writing import CoefficientWriter, TableHeader
from pix2face.face_files.coefficients import Face, configuration_to_json
from pix2face.models.morphable_model import MorphableModel, open_model

FACES_PER_TASK = 64
# Tasks that are under way or wait to be written: what bounds memory.
TASKS_AT_ONCE = 16

Outcome = Face | tuple[str, str]


@final
@dataclass(frozen=True)
class ConversionJob:
    """What determines the table.

    Attributes:
        folder: The source.
        kind: 300W-LP's or AFLW2000-3D's coefficient files, or photographs with annotated points.
        model: ``builtin`` or the path of a model file.
    """

    folder: Path
    kind: Literal["300wlp", "annotated"]
    model: str


@final
@dataclass(frozen=True)
class ConversionSummary:
    """What a job did.

    Attributes:
        n_faces: Rows of the table.
        rejected: Id and reason of each face that could not be used.
    """

    n_faces: int
    rejected: tuple[tuple[str, str], ...]


@lru_cache(maxsize=1)
def open_job(job: ConversionJob) -> tuple[MorphableModel, FaceSource]:
    """The model and the source of a job, kept until ``convert`` is done: listing a large folder takes seconds.

    Raises:
        UsageError: The folder is not there, or holds nothing of the kind.
        InputFileError: The model cannot be read.
    """
    model = open_model(job.model)
    if job.kind == "annotated":
        return model, AnnotatedFolder(job.folder, model)
    if not job.folder.is_dir():
        raise UsageError(f"{job.folder}: expected a folder of 300W-LP or AFLW2000-3D files, found none there")
    return model, W300LPFolder(job.folder, model)


def convert(
    job: ConversionJob, out: Path, executor: Executor | None, on_progress: Callable[[int], None]
) -> ConversionSummary:
    """Writes the table of a job, and the list of what was rejected beside it.

    Args:
        job: What to read.
        out: The table to write.
        executor: Where faces are read and fitted; None is here.
        on_progress: Called with the number of faces that have just been finished.

    Raises:
        UsageError: The source holds nothing, no face of it can be used, or a worker died.
    """
    try:
        return _convert(job, out, executor, on_progress)
    finally:
        open_job.cache_clear()  # the folder may change before the next call


def _convert(
    job: ConversionJob, out: Path, executor: Executor | None, on_progress: Callable[[int], None]
) -> ConversionSummary:
    model, source = open_job(job)
    configuration = {"source": job.folder.name, "source_sha256": source.sha256, "kind": job.kind}
    header = TableHeader(
        model_name=model.name,
        model_sha256=model.sha256,
        n_identity=model.n_identity,
        n_expression=model.n_expression,
        n_lighting=source.n_lighting,
        licence=source.licence,
        configuration=configuration_to_json({**configuration, "generator": f"pix2face {__version__}"}),
    )
    rejected: list[tuple[str, str]] = []
    with CoefficientWriter(out, header) as writer:
        for outcomes in _outcomes(job, len(source.sample_ids), executor):
            for outcome in outcomes:
                if isinstance(outcome, Face):
                    writer.add(outcome)
                else:
                    rejected.append(outcome)
                    writer.reject(*outcome)
            on_progress(len(outcomes))
        write_rejected(out.parent, rejected)
        if not writer.n_faces:
            raise UsageError(f"{job.folder}: expected at least one face that can be used; the first: {rejected[0][1]}")
    return ConversionSummary(writer.n_faces, tuple(rejected))


def read_faces(job: ConversionJob, start: int, stop: int) -> list[Outcome]:
    """Reads some faces of a source: what a worker runs."""
    _, source = open_job(job)
    outcomes: list[Outcome] = []
    for index in range(start, stop):
        try:
            outcomes.append(_checked(source.face(index)))
        except SampleRejectedError as error:
            outcomes.append((_as_text(source.sample_ids[index]), _as_text(str(error))))
    return outcomes


def _checked(face: Face) -> Face:
    """Refuses what a table cannot hold."""
    if not all(np.isfinite(values).all() for values in (face.identity, face.expression, face.camera.matrix)):
        raise SampleRejectedError(f"{face.sample_id}: expected finite coefficients, found NaN or infinity")
    if not is_text(str(face.image_path)):
        raise SampleRejectedError(f"{face.sample_id}: expected a path in UTF-8, which tables can hold; rename it")
    return face


def _outcomes(job: ConversionJob, n: int, executor: Executor | None) -> Iterator[list[Outcome]]:
    """The faces of the source in its order, a task at a time."""
    tasks = ((job, start, min(start + FACES_PER_TASK, n)) for start in range(0, n, FACES_PER_TASK))
    if executor is None:
        for task in tasks:
            yield read_faces(*task)
        return
    running: deque[Future[list[Outcome]]] = deque()
    try:
        running.extend(executor.submit(read_faces, *task) for task in islice(tasks, TASKS_AT_ONCE))
        while running:
            yield running.popleft().result()
            running.extend(executor.submit(read_faces, *task) for task in islice(tasks, 1))
    except BrokenProcessPool as error:
        raise UsageError("a worker died (out of memory?); run the same command again with fewer --workers") from error
    finally:
        for future in running:
            future.cancel()


def _as_text(text: str) -> str:
    """A text that UTF-8 can hold: bytes of file names that are none appear as their escapes."""
    return text.encode("utf-8", "backslashreplace").decode()
