"""Fixtures that all tests share."""

import os
from pathlib import Path

import pytest

import tests.type_checker  # noqa: F401 (pyproject names it as the checker of all signatures)

# Small networks and systems gain nothing from threads, and beside another job on the same cores every parallel section
# waits for the thread that is not running: a test of 3 seconds takes 60. Before anything loads torch.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")


@pytest.fixture(scope="session")
def shared_dir() -> Path:
    """Research data beside the project; tests that need it skip where it is absent."""
    folder = Path(os.environ.get("PIX2FACE_SHARED", Path(__file__).parents[2] / "shared"))
    if not (folder / "data").is_dir():
        pytest.skip(f"no research data at {folder}: set PIX2FACE_SHARED")
    return folder
