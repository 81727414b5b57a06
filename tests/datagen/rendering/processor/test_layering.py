"""Pictures are laid over one another."""

import numpy as np

from datagen.rendering.processor.layering import lay_over


def test_what_is_in_front_covers_what_is_behind() -> None:
    rng = np.random.default_rng(0)
    below, over = rng.random((5, 7, 3), dtype=np.float32), rng.random((5, 7, 4), dtype=np.float32)
    white = np.array([0.5, 1.0, 2.0], dtype=np.float32)
    expected = below * (1 - over[..., 3:]) + over[..., :3] * white
    lay_over(below, over[..., :3], over[..., 3], white)
    np.testing.assert_allclose(below, expected, rtol=1e-6)
