"""What the maps of the processor are made of: vector instructions, steps, and memory that is used again."""

import numpy as np
import pytest
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled
from datagen.rendering.processor.processor_maps import ProcessorMaps
from datagen.rendering.processor.transposing import transpose
from pix2face.geometry.camera import WeakPerspective, weak_perspective_camera
from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from tests.synthetic_models import small_head_model

SIZE = (64, 48)
CAMERA = weak_perspective_camera(WeakPerspective(0.2, np.diag([1.0, -1.0, -1.0]), np.array([24.0, 32.0])))


@compiled
def _transposed(points: ndarray, out: ndarray) -> None:
    transpose(points, (4, 12, 0, 20), out, 1, 6)


def test_four_points_are_transposed_and_nothing_else_is_written() -> None:
    points, out = np.arange(24, dtype=np.float32), np.full(20, -1, np.float32)
    _transposed(points, out)
    expected = np.full(20, -1, np.float32)
    for row, first in enumerate((1, 7, 13)):
        expected[first : first + 4] = points.reshape(-1, 4)[[1, 3, 0, 5], row]
    np.testing.assert_array_equal(out, expected)


def test_arrays_that_somebody_holds_are_not_written_again() -> None:
    model = small_head_model()
    maps = ProcessorMaps(model)
    first = maps.render(model.mean, CAMERA, SIZE)
    before = {name: values.copy() for name, values in first.items()}
    part = maps.render(model.mean, CAMERA, SIZE)["offset"][20:40]
    other = model.mean * np.float32(1.1)
    for _ in range(6):
        assert (maps.render(other, CAMERA, SIZE)["offset"][20:40] != part).any()
    for name, values in first.items():
        np.testing.assert_array_equal(values, before[name])
    np.testing.assert_array_equal(part, first["offset"][20:40])


def test_memory_that_nobody_sees_is_used_again() -> None:
    model = small_head_model()
    maps = ProcessorMaps(model)
    # The memory itself is held here: otherwise the system could hand out the same place again.
    memory = [maps.render(model.mean, CAMERA, SIZE)["pncc"].base.base.obj for _ in range(5)]
    assert len({id(own) for own in memory}) <= 2  # PNCC and offset are of one size


@pytest.mark.parametrize(("shift_mm", "dtype"), [(200, np.int16), (300, np.float32)])
def test_offsets_are_in_steps_where_these_can_hold_them(shift_mm: int, dtype: type) -> None:
    model = small_head_model()
    maps, vertices = ProcessorMaps(model), model.mean + np.float32([0, 0, shift_mm])
    offset = maps.render(vertices, CAMERA, SIZE, in_steps=True)["offset"]
    assert offset.dtype == dtype
    steps_per_mm = FIXED_POINT_STEPS_PER_MM if dtype is np.int16 else 1
    assert offset[..., 2].max() / steps_per_mm == pytest.approx(shift_mm, abs=0.01)
