"""Overlay, map picture, mesh and cloud show the face that was fitted, where it is."""

from dataclasses import replace
from io import BytesIO

import cv2
import numpy as np
import pytest
import trimesh
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.files.meshes.ply import encode_ply
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import Camera, HeadPose, Pinhole, pinhole_camera, rotation_of_pose
from pix2face.geometry.crops import FaceBox, crop_camera, crop_image, square_crop
from pix2face.geometry.maps import FaceMaps
from pix2face.models.rasterise import render_maps
from pix2face.photographs.fit_pictures import (
    HIDDEN_COLOUR,
    LANDMARK_COLOUR,
    MAPS_PX,
    OVERLAY_SCALE,
    draw_landmarks,
    draw_maps,
    draw_overlay,
)
from pix2face.photographs.landmark_visibility import landmarks_in_sight, visible_landmarks
from tests.cameras import posed_camera
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
GREY = 90
SIZE_PX = 200


def fitted(camera: Camera, landmarks: ndarray | None = None, seed: int = 0) -> FaceFit:
    """A face of the small head as a fit."""
    rng = np.random.default_rng(seed)
    identity, expression = rng.normal(size=MODEL.n_identity), rng.normal(size=MODEL.n_expression)
    vertices = MODEL.vertices(identity[None], expression[None])[0]
    landmarks3d = vertices[MODEL.landmarks["ibug68"]].astype(np.float64) if landmarks is None else landmarks
    return FaceFit(camera, identity, expression, MODEL, camera.project(landmarks3d), landmarks3d)


def weak(yaw_deg: float = 0.0, centre: tuple[float, float] = (150.0, 120.0)) -> Camera:
    return posed_camera(*centre, yaw_deg=yaw_deg, scale=0.6)


def near_pinhole() -> Camera:
    return pinhole_camera(
        Pinhole(400.0, np.array([150.0, 120.0]), rotation_of_pose(HeadPose(5, 20, 0)), np.array([10.0, 0.0, 500.0]))
    )


def grey_picture() -> ndarray:
    return np.full((240, 300, 3), GREY, dtype=np.uint8)


@pytest.mark.parametrize("camera", [weak(), weak(60), weak(-30, (20.0, 40.0)), near_pinhole()])
def test_the_overlay_covers_the_face_where_the_camera_puts_it(camera: Camera) -> None:
    fit = fitted(camera, seed=1)
    shown = draw_overlay(grey_picture(), fit, SIZE_PX)
    crop = square_crop(FaceBox.around(fit.landmarks2d), OVERLAY_SCALE, SIZE_PX)
    own_camera, background = crop_camera(fit.camera, crop), crop_image(grey_picture(), crop)
    face = render_maps(MODEL, fit.vertices, own_camera, SIZE_PX, SIZE_PX)["mask"]
    dots = dotted(own_camera.project(fit.landmarks3d))
    changed = (shown != background).any(axis=2)
    assert 5000 < face.sum() < 30_000
    assert changed[face].mean() > 0.999
    # Beyond what the oracle calls face lie the backs of face triangles (behind the scalp) and the dots of landmarks.
    corners = own_camera.project(fit.vertices[MODEL.is_face_vertex])
    beyond = ~dots & outside_box(corners)
    assert beyond.sum() > 2000
    assert not changed[beyond].any()


def dotted(landmarks2d: ndarray) -> ndarray:
    """Pixels within three of a landmark."""
    rows, columns = np.indices((SIZE_PX, SIZE_PX)) + 0.5
    distances = np.hypot(columns[..., None] - landmarks2d[:, 0], rows[..., None] - landmarks2d[:, 1])
    return np.asarray(distances.min(axis=2) < 3)


def outside_box(points: ndarray) -> ndarray:
    rows, columns = np.indices((SIZE_PX, SIZE_PX)) + 0.5
    (left, top), (right, bottom) = points.min(axis=0), points.max(axis=0)
    return np.asarray((columns < left) | (columns > right) | (rows < top) | (rows > bottom))


def test_a_landmark_has_its_dot_in_the_overlay() -> None:
    fit = fitted(weak(15))
    shown = draw_overlay(grey_picture(), fit, SIZE_PX)
    crop = square_crop(FaceBox.around(fit.landmarks2d), OVERLAY_SCALE, SIZE_PX)
    for x, y in np.floor(crop.to_crop(fit.landmarks2d)).astype(int):
        np.testing.assert_array_equal(shown[y, x], LANDMARK_COLOUR)


def test_landmarks_that_are_not_in_sight_are_red() -> None:
    fit = fitted(weak(15))
    crop = square_crop(FaceBox.around(fit.landmarks2d), OVERLAY_SCALE, SIZE_PX)
    places = np.floor(crop.to_crop(fit.landmarks2d)).astype(int)
    maps = render_maps(MODEL, fit.vertices, crop_camera(fit.camera, crop), SIZE_PX, SIZE_PX)
    mask = np.asarray(maps["mask"], dtype=bool)
    above = mask & (np.arange(SIZE_PX)[:, None] < places[30, 1])  # what is below the tip of the nose is under a cloth
    known = FaceMaps(maps["pncc"], maps["offset"], mask, above)
    in_sight = landmarks_in_sight(fit, known, crop)
    unknown = landmarks_in_sight(fit, replace(known, seen=None), crop)
    np.testing.assert_array_equal(unknown, visible_landmarks(fit))
    assert not in_sight[48:60].any()  # the outer lips
    assert unknown[48:60].any()
    np.testing.assert_array_equal(in_sight[36:48], unknown[36:48])  # the eyes
    shown = draw_overlay(grey_picture(), fit, SIZE_PX, in_sight)
    apart = [k for k in range(68) if np.sort(np.linalg.norm(places - places[k], axis=1))[1] > 4]
    assert {bool(in_sight[k]) for k in apart} == {True, False}
    for k in apart:
        colour = LANDMARK_COLOUR if in_sight[k] else HIDDEN_COLOUR
        np.testing.assert_array_equal(shown[places[k][1], places[k][0]], colour)


def test_what_faces_the_viewer_is_brighter() -> None:
    fit = fitted(weak())
    shown = draw_overlay(grey_picture(), fit, SIZE_PX).astype(int)
    crop = square_crop(FaceBox.around(fit.landmarks2d), OVERLAY_SCALE, SIZE_PX)
    nose_bridge, temple = crop.to_crop(fit.camera.project(np.array([[0.0, 60.0, 85.0], [68.0, 20.0, 40.0]])))
    brightness = [patch(shown, point).mean() for point in (nose_bridge, temple)]
    assert brightness[0] > brightness[1] + 15


def patch(image: ndarray, point: ndarray) -> ndarray:
    column, row = np.floor(point).astype(int)
    return image[row - 2 : row + 3, column - 2 : column + 3]


def test_a_face_larger_than_the_picture_and_a_tiny_picture_are_drawn() -> None:
    fit = fitted(posed_camera(5, 5, scale=9))
    for shape in ((8, 10, 3), (1, 1, 3)):
        assert draw_overlay(np.zeros(shape, np.uint8), fit, 64).shape == (64, 64, 3)


def test_undefined_and_far_landmarks_do_not_stop_a_drawing() -> None:
    fit = fitted(weak())
    landmarks2d = fit.landmarks2d.copy()
    landmarks2d[:6] = [[np.nan, 5], [np.inf, 5], [-np.inf, -np.inf], [1e300, 3], [-1e9, 3], [3e9, 1e12]]
    drawn = draw_landmarks(grey_picture(), landmarks2d)
    expected = draw_landmarks(grey_picture(), landmarks2d[6:])
    np.testing.assert_array_equal(drawn, expected)
    landmarks3d = fit.landmarks3d.copy()
    landmarks3d[0], landmarks3d[1] = np.nan, 1e200
    replaced = replace(fit, landmarks3d=landmarks3d)
    assert draw_overlay(grey_picture(), replaced, SIZE_PX).std() > 10


@pytest.mark.parametrize("value", [np.nan, 7.0])
def test_landmarks_without_extent_are_refused(value: float) -> None:
    fit = replace(fitted(weak()), landmarks2d=np.full((68, 2), value))
    with pytest.raises(DegenerateGeometryError, match="face box"):
        draw_overlay(grey_picture(), fit)


def test_drawing_leaves_the_picture_alone_and_marks_the_pixel_that_holds_the_landmark() -> None:
    image = np.zeros((40, 50, 3), np.uint8)
    drawn = draw_landmarks(image, np.array([[10.9, 20.1]]), (1, 2, 3))
    assert not image.any()
    rows, columns = np.nonzero(drawn.any(axis=2))
    assert (rows.mean(), columns.mean()) == (20, 10)
    np.testing.assert_array_equal(drawn[20, 10], [1, 2, 3])


def test_dots_are_small_beside_the_face_whatever_the_size_of_the_picture() -> None:
    landmarks2d = np.array([[40.0, 40.0], [130.0, 40.0], [40.0, 130.0], [130.0, 130.0]])
    for size_px in (200, 2000):
        drawn = draw_landmarks(np.zeros((size_px, size_px, 3), np.uint8), landmarks2d)
        assert 4 <= drawn.any(axis=2).sum() <= 4 * 5
    larger = draw_landmarks(np.zeros((2000, 2000, 3), np.uint8), 10 * landmarks2d)
    assert 4 * 80 < larger.any(axis=2).sum() < 4 * 250


@pytest.mark.parametrize(("side_px", "tile_px"), [(20, 32), (160, 160), (4000, MAPS_PX)])
def test_maps_are_shown_beside_the_crop_at_the_resolution_of_the_photograph(side_px: int, tile_px: int) -> None:
    mask = np.zeros((32, 32), dtype=bool)
    mask[4:28, 8:30] = True
    pncc, offset = (np.full((32, 32, 3), values, np.float32) * mask[..., None] for values in ((60, 0, -60), (3, -3, 6)))
    image = np.random.default_rng(0).integers(0, 256, (300, 200, 3)).astype(np.uint8)
    crop = square_crop(FaceBox(50, 60, 50 + side_px, 90), 1.0, 32)
    shown, *pictures = np.split(draw_maps(image, crop, FaceMaps(pncc, offset, mask)), 3, axis=1)
    assert len(shown) == tile_px
    np.testing.assert_array_equal(shown, crop_image(image, crop.with_size(tile_px)))
    inside = cv2.resize(mask.astype(np.float32), (tile_px, tile_px), interpolation=cv2.INTER_LINEAR)
    deep = cv2.erode(inside, np.ones((9 * tile_px // 32, 9 * tile_px // 32))) == 1
    beyond = cv2.dilate(inside, np.ones((9 * tile_px // 32, 9 * tile_px // 32))) == 0
    for picture, values, limit in zip(pictures, (pncc, offset), (120, 15), strict=True):
        expected = (values[16, 16] / (2 * limit) + 0.5) * 255
        assert np.abs(picture[deep] - expected).max() <= 1.5
        faded = 255 - 0.25 * (255 - shown[beyond].mean(axis=1))
        assert np.abs(picture[beyond] - faded[:, None]).max() <= 1


def test_a_cloud_is_written_in_its_colours() -> None:
    rng = np.random.default_rng(3)
    points, colours = rng.normal(0, 50, (120, 3)).astype(np.float32), rng.integers(0, 256, (120, 3)).astype(np.uint8)
    cloud = trimesh.load(BytesIO(encode_ply(points, colours)), file_type="ply")
    np.testing.assert_allclose(cloud.vertices, points, atol=1e-3)
    np.testing.assert_array_equal(cloud.colors[:, :3], colours)


def test_a_cloud_without_points_is_a_file_too() -> None:
    assert b"element vertex 0" in encode_ply(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8))
