"""Geometry in batches: the same faces, bounded memory, nearly as fast as a plain matrix product."""

import tracemalloc

import numpy as np
import pytest

from tests.benchmarks.geometry import measure, random_model
from tests.synthetic_models import small_head_model


@pytest.mark.parametrize("n", [0, 1, 7, 10])
def test_batches_are_the_faces_in_order(n: int) -> None:
    model, rng = small_head_model(), np.random.default_rng(0)
    identity, expression = rng.normal(size=(n, 12)), rng.normal(size=(n, 6))
    batches = list(model.vertex_batches(identity, expression, batch_bytes=3 * model.mean.nbytes))
    assert [len(batch) for batch in batches] == [3] * (n // 3) + [n % 3] * (n % 3 > 0)
    if n:
        np.testing.assert_allclose(np.concatenate(batches), model.vertices(identity, expression), atol=1e-4)


def test_memory_does_not_grow_with_the_number_of_faces() -> None:
    model = random_model(2000, 20, 5)
    peaks = []
    for n in (200, 4000):
        identity, expression = np.zeros((n, 20), np.float32), np.zeros((n, 5), np.float32)
        tracemalloc.start()
        for _ in model.vertex_batches(identity, expression, batch_bytes=1 << 20):
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
    assert peaks[1] < 8 << 20


def test_speed_and_error_are_those_of_a_matrix_product() -> None:
    found = measure(n_vertices=20000, n_faces=96)
    assert found["speed_of_product"] >= 0.6, found
    assert found["largest_error_mm"] < 1e-3, found
