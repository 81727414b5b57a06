"""Pictures and maps come from the same vertices: their edges lie in the same place."""

import cv2
import numpy as np
import pytest
from numpy import ndarray

from datagen.opengl.gl_context import GLContext
from datagen.rendering.renderer import Renderer
from pix2face.camera import Camera
from pix2face.morphable_model import MorphableModel, builtin_model
from tests.datagen.rendering.plain_scenes import camera_at, plain_drawer, scene_of
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.gl

SIZE, FINER = 96, 8
POSES = [(0, 0), (35, 10), (-70, 0), (90, -15), (20, -35), (-50, 35)]
CAMERAS = [camera_at(*pose, SIZE) for pose in POSES] + [camera_at(*pose, SIZE, 450) for pose in POSES]
NAMES = [f"{kind} {pose}" for kind in ("affine", "pinhole") for pose in POSES]


def true_coverage(model: MorphableModel, gl: GLContext, camera: Camera) -> tuple[ndarray, ndarray]:
    """Of the head and of the face mask, from maps drawn finer."""
    fine = camera.transformed(np.diag([FINER, FINER, 1.0]))
    maps = Renderer(model, SIZE * FINER, SIZE * FINER, gl).render(model.mean, fine)
    parts = (np.isfinite(maps.surface_depth), maps.mask > 0)
    head, face = (cv2.resize(part.astype(np.float32), (SIZE, SIZE), interpolation=cv2.INTER_AREA) for part in parts)
    return head, face


def edge_offsets(found: ndarray, truth: ndarray, where: ndarray) -> ndarray:
    """How far the edge of ``found`` lies outside that of ``truth`` along the edge's normal, px."""
    wide = [cv2.GaussianBlur(each, (0, 0), 1.2) for each in (found, truth)]
    slope = np.hypot(np.gradient(wide[1], axis=0), np.gradient(wide[1], axis=1))
    at_edge = where & (slope > 0.2) & (np.abs(wide[1] - 0.5) < 0.25)
    return ((wide[0] - wide[1]) / np.maximum(slope, 1e-6))[at_edge]


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_edges_of_picture_and_mask_coincide_within_half_a_pixel(gl: GLContext, camera: Camera) -> None:
    model = builtin_model()
    head, face = true_coverage(model, gl, camera)
    with plain_drawer(model, gl) as drawer:
        picture = drawer.draw(scene_of(model), camera, SIZE, SIZE)
    offsets = edge_offsets(picture.coverage, head, np.ones_like(head, dtype=bool))
    assert len(offsets) > 100
    assert np.abs(offsets).max() < 0.5
    assert abs(np.median(offsets)) < 0.05
    # Where the face ends at the silhouette, the mask's edge is the picture's.
    kernel = np.ones((7, 7), dtype=np.uint8)
    silhouette = cv2.dilate(np.abs(head - face), kernel) < 0.02
    offsets = edge_offsets(picture.coverage, face, silhouette)
    assert len(offsets) > 10
    assert np.abs(offsets).max() < 0.5


def test_the_measure_notices_half_a_pixel(gl: GLContext) -> None:
    model, camera = builtin_model(), CAMERAS[1]
    head, _ = true_coverage(model, gl, camera)
    moved = camera.transformed(np.array([[1, 0, 0.5], [0, 1, 0], [0, 0, 1]]))
    with plain_drawer(model, gl) as drawer:
        picture = drawer.draw(scene_of(model), moved, SIZE, SIZE)
    offsets = edge_offsets(picture.coverage, head, np.ones_like(head, dtype=bool))
    assert np.quantile(np.abs(offsets), 0.9) > 0.3


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
@pytest.mark.parametrize("make_model", [builtin_model, small_head_model])
def test_the_label_of_the_head_is_where_the_maps_see_the_head(gl: GLContext, make_model, camera: Camera) -> None:
    model = make_model()
    maps = Renderer(model, SIZE, SIZE, gl).render(model.mean, camera)
    expected = np.isfinite(maps.surface_depth)
    with plain_drawer(model, gl) as drawer:
        picture = drawer.draw(scene_of(model), camera, SIZE, SIZE)
    differ = (picture.labels == 1) != expected
    kernel = np.ones((3, 3), dtype=np.uint8)
    edge = cv2.dilate(expected.astype(np.uint8), kernel) != cv2.erode(expected.astype(np.uint8), kernel)
    assert not (differ & ~edge).any()
    assert differ.sum() <= 0.02 * edge.sum()
    assert set(np.unique(picture.labels)) == {0, 1}
    # Colours are full where all of a pixel is covered, and only there; notches in the neck's rim are finer.
    inner = cv2.erode(expected.astype(np.uint8), kernel, iterations=2) > 0
    assert np.quantile(np.abs(picture.coverage[inner] - 1), 0.999) < 1e-3
    assert np.quantile(np.abs(picture.radiance[inner] - 0.5), 0.999) < 1e-3
    outer = cv2.dilate(expected.astype(np.uint8), kernel, iterations=2) == 0
    assert picture.coverage[outer].max() == 0


def test_inner_edges_take_no_colour_from_the_background(gl: GLContext) -> None:
    """Colour divided by coverage is the head's own everywhere, however little of the pixel it covers."""
    model = builtin_model()
    with plain_drawer(model, gl) as drawer:
        picture = drawer.draw(scene_of(model), camera_at(60, 20, SIZE), SIZE, SIZE)
    covered = picture.coverage > 0.02
    assert (picture.coverage[covered] < 0.9).sum() > 50
    np.testing.assert_allclose(picture.radiance[covered] / picture.coverage[covered][:, None], 0.5, atol=2e-3)
