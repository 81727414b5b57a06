"""Jobs of one worker in this process; an OpenGL context that notices errors; a sample to make others of."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest

from datagen import process_pool
from datagen.jobs import executors
from datagen.opengl.gl_context import GLContext, create_gl_context
from pix2face.errors import GLUnavailableError
from pix2face.shards.sample import Sample
from pix2face.shards.shard_reader import ShardHeader, ShardReader
from tests.pix2face.benchmark_files import write_heldout
from tests.synthetic_models import small_head_model


class ThisProcess(Executor):
    """Calls as soon as something is handed over."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 (as an executor does)
            future.set_exception(error)
        return future


@contextmanager
def in_this_process(on_report: process_pool.OnReport) -> Iterator[Executor]:
    """An executor whose units tell of their progress as those of a process do."""
    told = SimpleNamespace(send_bytes=lambda content: on_report(*process_pool._REPORT.unpack(content)))
    with patch.object(process_pool, "_REPORTS", [told]):
        yield ThisProcess()


@pytest.fixture(scope="package", autouse=True)
def one_worker_is_this_process() -> Iterator[None]:
    """Starting a process takes seconds, and drawing a sample milliseconds. Pools of more workers are real."""
    real = executors.process_pool

    def opened(workers: int, on_report: process_pool.OnReport) -> AbstractContextManager[Executor]:
        return in_this_process(on_report) if workers == 1 else real(workers, on_report)

    with patch.object(executors, "process_pool", opened):
        yield


@pytest.fixture(scope="session")
def gl_session() -> Iterator[GLContext]:
    """One context for all tests of a process; they skip where there is none."""
    try:
        context = create_gl_context()
    except GLUnavailableError as error:
        pytest.skip(str(error))
    with context:
        yield context


@pytest.fixture
def gl(gl_session: GLContext) -> Iterator[GLContext]:
    """The context, with no error flag set before and none left behind."""
    assert gl_session.context.error == "GL_NO_ERROR"
    yield gl_session
    assert gl_session.context.error == "GL_NO_ERROR"


@pytest.fixture
def base(tmp_path: Path) -> tuple[ShardHeader, Sample]:
    """A sample of a shard, and the header."""
    write_heldout(tmp_path / "base", small_head_model(), n=1)
    reader = ShardReader(tmp_path / "base" / "shard-00000.h5")
    return reader.header, reader.read(0)
