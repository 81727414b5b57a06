"""The oracle itself, held to ray casting and to what a rasteriser must do."""

import numpy as np
import pytest

from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.camera import Camera, HeadPose, Pinhole, WeakPerspective, pinhole_camera, rotation_of_pose
from pix2face.geometry.camera import weak_perspective_camera as weak
from pix2face.models.rasterise import interpolate, rasterise, render_maps, shows_outside
from tests.meshes import ray_casting
from tests.synthetic_models import small_head_model

SIZE = 48
ROTATION = rotation_of_pose(HeadPose(10, 35, -8))
AFFINE = weak(WeakPerspective(SIZE / 300, ROTATION, np.array([SIZE / 2 + 0.3, SIZE / 2])))
PINHOLE = pinhole_camera(
    Pinhole(SIZE / 300 * 400, np.array([SIZE / 2, SIZE / 2]), ROTATION, np.array([3.0, -4.0, 400.0]))
)
FLAT = Camera(np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))


@pytest.mark.parametrize("camera", [AFFINE, PINHOLE], ids=["affine", "pinhole"])
def test_it_agrees_with_ray_casting(camera: Camera) -> None:
    pytest.importorskip("rtree", reason="trimesh casts rays through rtree")
    model = small_head_model()
    fragments = rasterise(camera.matrix, model.mean.astype(np.float64), model.triangles, SIZE, SIZE)
    triangle, points = ray_casting(camera, model.mean, model.triangles, SIZE)
    hit, covered = triangle >= 0, fragments.triangle >= 0
    assert covered.sum() > 500
    assert (hit != covered).sum() <= 2  # rays through an edge may slip between triangles
    both = hit & covered
    np.testing.assert_allclose(fragments.depth[both], camera.depth(points[both]), atol=1e-6)


@pytest.mark.parametrize("camera", [AFFINE, PINHOLE], ids=["affine", "pinhole"])
def test_interpolated_points_project_to_their_pixel(camera: Camera) -> None:
    """Perspective-correct: the point of the surface that a pixel sees lies on the ray through its centre."""
    model = small_head_model()
    fragments = rasterise(camera.matrix, model.mean, model.triangles, SIZE, SIZE)
    points = interpolate(fragments, model.mean, model.triangles)
    covered = fragments.triangle >= 0
    row, column = np.nonzero(covered)
    np.testing.assert_allclose(camera.project(points[covered]), np.column_stack([column, row]) + 0.5, atol=1e-6)
    np.testing.assert_allclose(camera.depth(points[covered]), fragments.depth[covered], atol=1e-6)


def test_centres_on_shared_edges_are_covered_once() -> None:
    """A square cut along its diagonal, which runs through pixel centres; corners on pixel centres too."""
    corners = np.array([[0.5, 0.5, 0], [8.5, 0.5, 0], [8.5, 8.5, 0], [0.5, 8.5, 0]])
    halves = [np.array([[0, 1, 2]], np.int32), np.array([[0, 2, 3]], np.int32)]
    covered = [rasterise(FLAT.matrix, corners, half, 10, 10).triangle >= 0 for half in halves]
    assert not (covered[0] & covered[1]).any()
    together = covered[0] | covered[1]
    expected = np.zeros((10, 10), dtype=bool)
    expected[:8, :8] = True  # top and left edges own their centres, bottom and right ones do not
    np.testing.assert_array_equal(together, expected)


def test_the_nearest_triangle_wins_whatever_the_order() -> None:
    square = np.array([[0.0, 0, 0], [8, 0, 0], [0, 8, 0]])
    vertices = np.concatenate([square + [0, 0, 5], square + [0, 0, 2]])
    for triangles in (np.array([[0, 1, 2], [3, 4, 5]]), np.array([[3, 4, 5], [0, 1, 2]])):
        fragments = rasterise(FLAT.matrix, vertices, triangles.astype(np.int32), 8, 8)
        assert (fragments.depth[fragments.triangle >= 0] == 2).all()


@pytest.mark.parametrize("at_a_time", [1, 500_000])
def test_of_equally_near_triangles_the_first_wins(at_a_time: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where they are not looked at together."""
    monkeypatch.setattr("pix2face.models.rasterise.CANDIDATES_AT_A_TIME", at_a_time)
    vertices = np.array([[0.0, 0, 5], [8, 0, 5], [0, 8, 5], [0, 0, 9], [8, 0, 9], [0, 8, 9]])
    triangles = np.array([[3, 4, 5], [0, 1, 2], [1, 2, 0], [0, 2, 1]], dtype=np.int32)
    fragments = rasterise(FLAT.matrix, vertices, triangles, 8, 8)
    assert set(np.unique(fragments.triangle)) == {-1, 1}
    points = interpolate(fragments, vertices, triangles)[fragments.triangle == 1]
    np.testing.assert_allclose(points[:, 2], 5)


def test_the_mean_face_has_no_offset_and_its_own_points_as_pncc() -> None:
    model = small_head_model()
    maps = render_maps(model, model.mean, AFFINE, SIZE, SIZE)
    assert maps["mask"].sum() > 300
    assert not maps["offset"].any()
    assert not maps["pncc"][~maps["mask"]].any()
    row, column = np.nonzero(maps["mask"])
    np.testing.assert_allclose(
        AFFINE.project(maps["pncc"][maps["mask"]]), np.column_stack([column, row]) + 0.5, atol=1e-4
    )


def test_what_is_not_face_hides_but_is_not_in_the_mask() -> None:
    model = small_head_model()
    behind = weak(WeakPerspective(SIZE / 300, rotation_of_pose(HeadPose(0, 180, 0)), np.full(2, SIZE / 2)))
    maps = render_maps(model, model.mean, behind, SIZE, SIZE)
    assert np.isfinite(maps["surface_depth"]).sum() > 500
    # Seen from behind, ears at most stick out.
    assert maps["mask"].sum() < 0.1 * np.isfinite(maps["surface_depth"]).sum()


def test_a_mirroring_camera_still_shows_the_outside() -> None:
    model = small_head_model()
    mirrored = AFFINE.transformed(np.array([[-1.0, 0, SIZE], [0, 1, 0], [0, 0, 1]]))
    straight = shows_outside(AFFINE, model.mean, model.triangles)
    np.testing.assert_array_equal(shows_outside(mirrored, model.mean, model.triangles), straight)
    np.testing.assert_array_equal(
        render_maps(model, model.mean, mirrored, SIZE, SIZE)["mask"][:, ::-1].sum(),
        render_maps(model, model.mean, AFFINE, SIZE, SIZE)["mask"].sum(),
    )


def test_points_behind_a_pinhole_are_an_error() -> None:
    model = small_head_model()
    inside = pinhole_camera(Pinhole(50.0, np.full(2, SIZE / 2), ROTATION, np.array([0.0, 0, 20])))
    with pytest.raises(DegenerateGeometryError, match="in front of the camera"):
        rasterise(inside.matrix, model.mean, model.triangles, SIZE, SIZE)
    with pytest.raises(DegenerateGeometryError, match="finite"):
        rasterise(AFFINE.matrix * np.nan, model.mean, model.triangles, SIZE, SIZE)


@pytest.mark.parametrize(("height", "width"), [(4, 9), (9, 4)])
def test_a_picture_that_is_not_square_is_filled_to_its_corners(height: int, width: int) -> None:
    vertices = np.array([[-50.0, -50, 1], [150, -50, 1], [-50, 150, 1]])
    fragments = rasterise(np.eye(4), vertices, np.array([[0, 1, 2]], dtype=np.int32), height, width)
    assert fragments.triangle.shape == (height, width)
    assert (fragments.triangle == 0).all()
    places = interpolate(fragments, vertices, np.array([[0, 1, 2]], dtype=np.int32))
    np.testing.assert_allclose(places[-1, -1], [width - 0.5, height - 0.5, 1])
