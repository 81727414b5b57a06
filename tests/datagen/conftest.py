"""An OpenGL context that notices errors before and after each test that uses it."""

from collections.abc import Iterator

import pytest

from datagen.gl_context import GLContext, create_gl_context
from pix2face.errors import GLUnavailableError


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
