"""What a worker does with a unit, wherever it is called from."""

import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from datagen.jobs import render_unit
from datagen.jobs.render_job import RenderJob
from datagen.jobs.render_unit import Unit, UnitReport
from datagen.opengl.gl_context import GLSettings

N_THREADS = 16


@pytest.fixture
def hasty_threads() -> Iterator[None]:
    """Threads take turns as often as they can, so that races show."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("hasty_threads")
def test_all_units_of_a_process_are_drawn_by_one_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker of a cluster may call from several threads at once; a context of OpenGL belongs to one."""
    monkeypatch.setattr(render_unit, "_render_unit", lambda unit: UnitReport(threading.get_ident(), {}, 0))
    unit = Unit(RenderJob(tmp_path, "builtin", 0, 1), 0, tmp_path, GLSettings(), "", "")
    together = threading.Barrier(N_THREADS)

    def call(_: int) -> int:
        together.wait()
        return render_unit.render_unit(unit).n_faces

    with ThreadPoolExecutor(N_THREADS) as pool:
        assert len(set(pool.map(call, range(N_THREADS)))) == 1
