import os

import pytest

from datagen.process_pool import ONE_THREAD, limit_threads


def test_workers_draw_and_compute_with_one_thread_unless_told_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ONE_THREAD:
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    limit_threads()
    found = {variable: os.environ.pop(variable) for variable in ONE_THREAD}
    assert found == {**ONE_THREAD, "OMP_NUM_THREADS": "3"}
    assert found["LP_NUM_THREADS"] == "0"  # llvmpipe draws in the caller's thread
