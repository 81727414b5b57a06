"""What is nearest at each sample is what the oracle finds, and coordinates of any size are safe."""

import numpy as np
import pytest
from numpy import ndarray

from datagen.rendering.processor.nearest import NOWHERE, draw_nearest, in_window, may_be_seen
from datagen.rendering.scenes.scene_visibility import clip_at_near_plane, see_scene
from pix2face.geometry.camera import Camera
from pix2face.models.rasterise import rasterise, shows_outside
from tests.datagen.rendering.plain_scenes import camera_at
from tests.synthetic_models import small_head_model

SIZE = 64
WHOLE = (0, 0, SIZE, SIZE)


def drawn(points: list, triangles: list, size: int = 8) -> tuple[ndarray, ndarray]:
    nearest, seen = np.full((size, size), np.inf, np.float32), np.zeros((size, size), np.float32)
    corners = np.array(triangles, dtype=np.int32)
    draw_nearest(np.array(points, dtype=np.float32), corners, 0.0, NOWHERE, (1.0, 1.0), nearest, seen)
    return nearest, seen


@pytest.mark.parametrize("distance_mm", [None, 400])
@pytest.mark.parametrize("pose", [(0, 0), (40, 30), (-80, 10), (150, -10)])
def test_centres_of_pixels_see_the_triangles_of_the_oracle(pose: tuple[int, int], distance_mm: int | None) -> None:
    model, camera = small_head_model(), camera_at(*pose, SIZE, distance_mm)
    expected = rasterise(camera.matrix, model.mean, model.triangles, SIZE, SIZE)
    samples = see_scene((model.mean, model.triangles), [], camera, (SIZE, SIZE), WHOLE)[1::2, 1::2]
    is_same = samples[..., 0] == expected.triangle + 1
    assert (~is_same).mean() < 0.002  # centres on an edge
    is_seen = (samples[..., 0] > 0) & is_same
    depth = camera.depth(model.mean)[model.triangles[expected.triangle[is_seen]]]
    assert (samples[..., 1][is_seen] > depth.min(axis=1) - 0.01).all()
    assert (samples[..., 1][is_seen] < depth.max(axis=1) + 0.01).all()


def test_backs_are_drawn_within_their_box_alone() -> None:
    model, camera = small_head_model(), camera_at(0, 60, SIZE)
    outside = shows_outside(camera, model.mean, model.triangles)

    def n_backs(backs: tuple[int, int, int, int]) -> int:
        seen = see_scene((model.mean, model.triangles), [], camera, (SIZE, SIZE), backs)[..., 0].astype(int)
        return int((~outside[seen[seen > 0] - 1]).sum())

    assert n_backs(NOWHERE) == 0
    assert n_backs(WHOLE) > 50


def test_triangles_that_share_edges_leave_no_sample_between_them() -> None:
    """Corners of a fan lie on samples and on their rows and columns, too."""
    rng = np.random.default_rng(0)
    for middle in (*rng.uniform(2, 6, (50, 2)), np.array([3.5, 4.5]), np.array([4.0, 3.5])):
        corners = [[0, 0], [3.5, 0], [8, 0], [8, 4.5], [8, 8], [2.25, 8], [0, 8], [0, 3.5], middle]
        _, seen = drawn([[*corner, 1] for corner in corners], [[k, (k + 1) % 8, 8] for k in range(8)])
        assert (seen > 0).all()


@pytest.mark.parametrize("far", [1e9, -1e9, 3e38, -3e38, np.inf, np.nan])
def test_coordinates_of_any_size_are_safe(far: float) -> None:
    points = [[far, 2, 1], [2, far, 1], [far, far, 1], [3, 3, far], [1, 1, 1], [6, 1, 1], [1, 6, 1]]
    corners = [[a, b, c] for a in range(7) for b in range(a) for c in range(b)]
    nearest, seen = drawn(points, corners)
    assert not np.isnan(nearest).any()
    assert seen[2, 2] > 0
    assert len(corners) >= seen.max()


@pytest.mark.parametrize("n_near", [1, 2, 3])
def test_a_mesh_is_cut_before_the_camera(n_near: int) -> None:
    """The camera looks down the z axis from 20 mm, so that what is above z = 10 mm is cut off."""
    camera = Camera(np.array([[50.0, 0, 16, 320], [0, -50, 16, 320], [0, 0, -1, 20], [0, 0, -1, 20]]))
    heights = np.where(np.arange(3) < n_near, 15, 0)
    points = np.column_stack([[0, 10, 0], [0, 0, 10], heights]).astype(np.float32)
    cut, corners = clip_at_near_plane(points, np.array([[0, 1, 2], [2, 0, 1]], dtype=np.int32), camera)
    a, b, c = (cut[corners[:, k]].astype(float) for k in range(3))
    crosses = np.cross(b - a, c - a)
    share = {1: 1 - (5 / 15) ** 2, 2: (10 / 15) ** 2, 3: 0}[n_near]
    first, second, third = points.astype(float)
    whole = np.linalg.norm(np.cross(second - first, third - first))
    assert np.linalg.norm(crosses, axis=1).sum() == pytest.approx(2 * share * whole, rel=1e-5)
    assert (camera.depth(cut[corners].reshape(-1, 3)) > 10 - 1e-4).all()
    # Pieces turn as their triangle does.
    assert (crosses @ np.cross(second - first, third - first) > 0).all()


def test_every_triangle_that_shows_in_a_pixel_may_be_seen() -> None:
    rng = np.random.default_rng(0)
    middles, reach = rng.uniform(-1.2, 1.2, (300, 1, 3)), rng.choice([0.05, 0.4], (300, 1, 1))
    points = (middles + reach * rng.normal(size=(300, 3, 3))).reshape(-1, 3).astype(np.float32)
    farthest = rng.uniform(0.2, 0.8, (16, 16)).astype(np.float32)
    placed = in_window(points, np.eye(4), 16, 16)
    corners = np.arange(900, dtype=np.int32).reshape(-1, 3)
    found = may_be_seen(placed, corners, farthest)
    for triangle, is_found in zip(corners, found, strict=True):
        shown = farthest.copy()
        draw_nearest(placed, triangle[None], 0.0, NOWHERE, (1.0, 0.0), shown, np.zeros_like(shown))
        assert is_found or (shown == farthest).all()
    assert 50 < found.sum() < 250


def test_what_reaches_behind_a_pinhole_may_be_seen() -> None:
    clip = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0]])
    points = np.array([[0, 0, 1], [1, 0, 1], [0, 1, -1]], dtype=np.float32)
    assert may_be_seen(in_window(points, clip, 8, 8), np.array([[0, 1, 2]], np.int32), np.zeros((8, 8), np.float32))[0]
