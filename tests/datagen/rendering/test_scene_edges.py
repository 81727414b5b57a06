"""Pictures and maps come from the same vertices: their edges lie in the same place."""

import cv2
import numpy as np
import pytest

from datagen.opengl.gl_context import GLContext
from datagen.rendering.renderer import Renderer
from pix2face.geometry.camera import Camera
from pix2face.models.morphable_model import builtin_model
from tests.datagen.rendering.edges import FINER, edge_offsets, true_coverage
from tests.datagen.rendering.plain_scenes import camera_at, plain_drawer, scene_of
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.gl

SIZE = 96
POSES = [(0, 0), (35, 10), (-70, 0), (90, -15), (20, -35), (-50, 35)]
CAMERAS = [camera_at(*pose, SIZE) for pose in POSES] + [camera_at(*pose, SIZE, 450) for pose in POSES]
NAMES = [f"{kind} {pose}" for kind in ("affine", "pinhole") for pose in POSES]


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_edges_of_picture_and_mask_coincide_within_half_a_pixel(gl: GLContext, camera: Camera) -> None:
    model = builtin_model()
    head, face = true_coverage(Renderer(model, SIZE * FINER, SIZE * FINER, gl), model.mean, camera)
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
    head, _ = true_coverage(Renderer(model, SIZE * FINER, SIZE * FINER, gl), model.mean, camera)
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
    expected = np.isfinite(maps["surface_depth"])
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
