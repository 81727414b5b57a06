"""Fixtures that all tests share."""

import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

import tests.type_checker  # noqa: F401 (pyproject names it as the checker of all signatures)

# Small networks and systems gain nothing from threads, and beside another job on the same cores every parallel section
# waits for the thread that is not running: a test of 3 seconds takes 60. Before anything loads torch.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

# How long an example takes depends on what else runs.
settings.register_profile("without deadlines", deadline=None)
settings.load_profile("without deadlines")


def pytest_make_parametrize_id(val: object) -> str | None:
    """Keeps the names of tests short: workers send them to and fro, and one was 24 MB of JSON."""
    return f"{val[:40]!r}..." if isinstance(val, str | bytes) and len(val) > 100 else None


@pytest.fixture(scope="session", autouse=True)
def coverage_of_processes() -> Iterator[dict[str, str]]:
    """Keeps coverage from measuring the programs that tests start, most of whose time is their start.

    Yields:
        The variables that ``measured_processes`` sets again.
    """
    taken = {name: os.environ.pop(name) for name in list(os.environ) if name.startswith("COVERAGE_PROCESS")}
    yield taken
    os.environ.update(taken)


@pytest.fixture
def measured_processes(coverage_of_processes: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Measures the programs that a test starts: for code that runs nowhere else."""
    for name, value in coverage_of_processes.items():
        monkeypatch.setenv(name, value)


@pytest.fixture(scope="session", autouse=True)
def grids_of_the_same_points_are_made_once() -> Iterator[None]:
    """A grid takes half a second for each model that is opened, and most tests open the same few."""
    from pix2face.fitting.prepared_model import VertexGrid

    make = VertexGrid.of

    @lru_cache(maxsize=8)
    def grid_of(content: bytes) -> VertexGrid:
        return make(np.frombuffer(content, dtype=np.float32).reshape(-1, 3))

    def of(points: np.ndarray) -> VertexGrid:
        assert points.dtype == np.float32
        return grid_of(points.tobytes())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(VertexGrid, "of", of)
        yield


@pytest.fixture(scope="session")
def shared_dir() -> Path:
    """Research data beside the project; tests that need it skip where it is absent."""
    folder = Path(os.environ.get("PIX2FACE_SHARED", Path(__file__).parents[2] / "shared"))
    if not (folder / "data").is_dir():
        pytest.skip(f"no research data at {folder}: set PIX2FACE_SHARED")
    return folder
