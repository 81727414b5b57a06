import numpy as np
import pytest

from training.data.decoded_sample import DecodedSample


@pytest.mark.parametrize(("y", "x", "has_seen"), [(5, 3, True), (4, 4, False), (0, 0, False)])
def test_a_sample_comes_back_from_its_bytes(y, x, has_seen):
    rng = np.random.default_rng(0)
    sample = DecodedSample(
        image=rng.integers(0, 256, (9, 7, 3)).astype(np.uint8),
        pncc=rng.integers(-30000, 30000, (y, x, 3)).astype(np.int16),
        offset=rng.integers(-30000, 30000, (y, x, 3)).astype(np.int16),
        mask=rng.integers(0, 2, (y, x)).astype(np.uint8),
        seen=rng.integers(0, 2, (y, x)).astype(np.uint8) if has_seen else None,
        corner=(2, 1),
        landmarks2d=rng.normal(size=(68, 2)).astype(np.float32),
    )
    found = DecodedSample.from_bytes(memoryview(sample.to_bytes()))
    for name in ("image", "pncc", "offset", "mask", "landmarks2d"):
        assert np.array_equal(getattr(found, name), getattr(sample, name)), name
    assert found.corner == (2, 1)
    assert (found.seen is not None) == has_seen
    if has_seen:
        assert np.array_equal(found.seen, sample.seen)
