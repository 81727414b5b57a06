"""An OpenGL context that notices errors before and after each test that uses it; a sample to make others of."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from datagen.opengl.gl_context import GLContext, create_gl_context
from pix2face.errors import GLUnavailableError
from pix2face.shards.sample import Sample
from pix2face.shards.shard_reader import ShardHeader, ShardReader
from tests.pix2face.benchmark_files import write_heldout
from tests.synthetic_models import small_head_model


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
