"""Converts a folder of coefficient files or annotated photographs into one table, on any number of processes.

Each face depends on its files and the model alone, and faces are written in the order of the source as they come. So
the table is the same for any number of workers, and memory does not grow with the number of faces. Faces that cannot
be used are listed with the reason.
"""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Literal, final

import numpy as np

from datagen.faces.fit_landmark_folder import AnnotatedFolder
from datagen.faces.sources import FaceSource, W300LPFolder, is_text
from pix2face import __version__
from pix2face.command_line import REJECTED_FILE, write_rejected
from pix2face.errors import SampleRejectedError, UsageError
from pix2face.face_files.coefficient_writing import CoefficientWriter, TableHeader
from pix2face.face_files.coefficients import Face, configuration_to_json
from pix2face.models.morphable_model import MorphableModel, open_model

FACES_PER_TASK = 64
# Tasks that run or wait to be written; this bounds the memory.
TASKS_AT_ONCE = 16

Outcome = Face | tuple[str, str]


@final
@dataclass(frozen=True)
class ConversionJob:
    """What determines the table."""

    folder: Path  # the source
    kind: Literal["300wlp", "annotated"]  # coefficient files, or photographs with annotated points
    model: str  # `builtin` or the path of a model file


@final
@dataclass(frozen=True)
class ConversionSummary:
    """The result of a job: the number of faces in the table, and id and reason of each rejected face."""

    n_faces: int
    rejected: tuple[tuple[str, str], ...]


@lru_cache(maxsize=1)
def open_job(job: ConversionJob) -> tuple[MorphableModel, FaceSource]:
    """Opens model and source of a job. They are kept until ``convert`` is done: listing a large folder takes seconds.

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
    """Writes the table of a job to ``out``, and the list of rejected faces beside it.

    Without an executor, faces are read and fitted in this process. ``on_progress`` gets the number of faces that have
    just been finished.

    Raises:
        UsageError: The source is empty, none of its faces can be used, or a worker died.
    """
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
    with ExitStack() as stack:
        stack.callback(open_job.cache_clear)  # the folder may change before the next call
        writer = stack.enter_context(CoefficientWriter(out, header))
        for outcomes in _outcomes(job, len(source.sample_ids), executor):
            for outcome in outcomes:
                if isinstance(outcome, Face):
                    writer.add(outcome)
                else:
                    rejected.append(outcome)
                    writer.reject(*outcome)
            on_progress(len(outcomes))
        write_rejected(rejected_path(out), rejected)
        if not writer.n_faces:
            raise UsageError(f"{job.folder}: expected at least one face that can be used; the first: {rejected[0][1]}")
    return ConversionSummary(writer.n_faces, tuple(rejected))


def rejected_path(table: Path) -> Path:
    """The list of rejected faces beside a table: NAME.rejected.jsonl, since a folder may hold several tables."""
    return table.with_suffix(f".{REJECTED_FILE}")


def read_faces(job: ConversionJob, start: int, stop: int) -> list[Outcome]:
    """Reads some faces of a source, in a worker."""
    _, source = open_job(job)
    outcomes: list[Outcome] = []
    for index in range(start, stop):
        try:
            outcomes.append(_checked(source.face(index)))
        except SampleRejectedError as error:
            outcomes.append((_as_text(source.sample_ids[index]), _as_text(str(error))))
    return outcomes


def _checked(face: Face) -> Face:
    """Refuses faces that a table cannot hold."""
    if not all(np.isfinite(values).all() for values in (face.identity, face.expression, face.camera.matrix)):
        raise SampleRejectedError(f"{face.sample_id}: expected finite coefficients, found NaN or infinity")
    if not is_text(str(face.image_path)):
        raise SampleRejectedError(f"{face.sample_id}: expected a path in UTF-8, which tables can hold; rename it")
    return face


def _outcomes(job: ConversionJob, n: int, executor: Executor | None) -> Iterator[list[Outcome]]:
    """The faces of the source in order, one task at a time."""
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


def _as_text(text: str) -> str:
    """A text that UTF-8 can hold: other bytes of file names become escapes."""
    return text.encode("utf-8", "backslashreplace").decode()
