"""Which pixels of the head are left to be shaded."""

import numpy as np

from datagen.rendering.processor.scene_edges import shown_kinds


def test_the_head_is_shaded_unless_hair_hides_a_pixel_and_all_around_it() -> None:
    kind = np.full((6, 7), 0.25, dtype=np.float32)
    near, far = np.zeros((2, 6, 7, 4), dtype=np.float32)
    near[1:5, 1:6, 3] = far[:, :, 3] = 1
    expected = kind.copy()
    expected[2:4, 2:5] = 0
    np.testing.assert_array_equal(shown_kinds(kind, (near, far)), expected)
    # A pixel at the border takes no colours from beyond it; hair that lets light through hides nothing.
    near[..., 3] = 1
    assert not shown_kinds(kind, (near, far))[1:-1, 1:-1].any()
    near[..., 3] = 0.999
    np.testing.assert_array_equal(shown_kinds(kind, (near, far)), kind)
    assert (kind == 0.25).all()
