"""The order of triangles of several meshes, and where the inside of a head may be seen."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datagen.rendering.processor.nearest import NOWHERE
from datagen.rendering.scenes.scene_meshes import MAX_TURNS, far_to_near
from datagen.rendering.scenes.scene_openings import Openings
from pix2face.models.morphable_model import builtin_model
from pix2face.models.rasterise import rasterise, shows_outside
from tests.datagen.rendering.plain_scenes import camera_at
from tests.synthetic_models import small_head_model


def meshes_of(depths: list[list[float]]) -> tuple[list[np.ndarray], np.ndarray]:
    """Meshes of one triangle for each depth."""
    triangles, start = [], 0
    for mesh in depths:
        triangles.append(np.arange(start, start + 3 * len(mesh), dtype=np.int32).reshape(-1, 3))
        start += 3 * len(mesh)
    return triangles, np.repeat(np.concatenate([np.array(mesh) for mesh in depths]), 3).astype(np.float32)


@given(st.lists(st.lists(st.floats(-500, 500, width=32), min_size=1, max_size=40), min_size=1, max_size=6))
def test_every_triangle_is_drawn_once_and_those_of_a_turn_from_far_to_near(depths: list[list[float]]) -> None:
    triangles, depth = meshes_of(depths)
    order, turns = far_to_near(triangles, depth)
    np.testing.assert_array_equal(np.sort(order), np.arange(sum(len(mesh) for mesh in depths)))
    owner = np.repeat(np.arange(len(depths)), [len(mesh) for mesh in depths])[order]
    np.testing.assert_array_equal(owner, np.repeat(*np.array(turns).T))
    assert len(turns) <= max(MAX_TURNS, len(depths))
    if len(depths) == 1:
        sorted_depth = depth[np.concatenate(triangles)[order][:, 0]]
        assert (np.diff(sorted_depth) <= 0).all()


def test_meshes_that_lie_apart_have_one_turn_each_the_farther_first() -> None:
    order, turns = far_to_near(*meshes_of([[1, 3, 2], [30, 10, 20]]))
    assert turns == [(1, 3), (0, 3)]
    assert order.tolist() == [3, 5, 4, 1, 2, 0]


def test_meshes_that_lie_within_one_another_take_turns() -> None:
    _, turns = far_to_near(*meshes_of([[0, 50, 100], [25, 75]]))
    assert turns == [(0, 1), (1, 1), (0, 1), (1, 1), (0, 1)]


@pytest.mark.parametrize("make_model", [builtin_model, small_head_model])
@pytest.mark.parametrize("distance_mm", [None, 400])
def test_backs_are_seen_through_openings_alone(make_model, distance_mm: float | None) -> None:
    model = make_model()
    openings, n_seen = Openings(model), 0
    for yaw, pitch in ((0, 0), (40, 30), (-80, 10), (150, -10), (10, 60), (0, -60), (90, 45)):
        camera = camera_at(yaw, pitch, 96, distance_mm)
        seen = rasterise(camera.matrix, model.mean, model.triangles, 96, 96).triangle
        outside = shows_outside(camera, model.mean, model.triangles)
        rows, columns = np.nonzero((seen >= 0) & ~outside[np.maximum(seen, 0)])
        box = openings.box(model.mean, camera, 96, 96)
        if not len(rows):
            continue
        n_seen += len(rows)
        left, top, right, bottom = box
        within = (columns >= left) & (columns < right) & (rows >= top) & (rows < bottom)
        # Gums and teeth have openings of their own, which other parts hide but for a pixel.
        assert (~within).sum() <= 2
    assert n_seen > 100


def test_a_head_seen_from_before_shows_no_inside() -> None:
    model = builtin_model()
    assert Openings(model).box(model.mean, camera_at(0, -10, 96), 96, 96) == NOWHERE
