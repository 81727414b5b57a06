"""The OpenGL renderer against the oracle."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy import ndarray
from scipy import ndimage

from datagen.opengl.gl_context import GLContext
from datagen.rendering.renderer import Renderer, visible_landmarks
from datagen.sampling.faces import sample_faces
from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    WeakPerspective,
    linearised,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.models.rasterise import render_maps
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.gl

LIMIT_MM = 0.02
# Neighbouring pixels whose depths or points of the mean face differ by more lie on two sheets of the surface (lips
# touch), or on one that is seen edge on.
FOLD_MM_PX = 1100.0  # at 256 px some 4 mm, twice that at 128 px, where neighbours are twice as far apart


@dataclass
class Comparison:
    """Counts over many faces."""

    border: int = 0
    mask_differs: int = 0
    inside: int = 0
    off: int = 0
    smooth: int = 0
    worst_on_smooth_mm: float = 0.0

    def add(self, rendered: dict[str, ndarray], expected: dict[str, ndarray]) -> None:
        """Compares one face."""
        mask = expected["mask"]
        around = ndimage.binary_dilation(mask, np.ones((3, 3))) & ~ndimage.binary_erosion(mask, np.ones((3, 3)))
        self.border += int(around.sum())
        self.mask_differs += int((rendered["mask"] != mask).sum())
        both = rendered["mask"] & mask
        error = np.max(
            [np.abs(rendered[name] - expected[name]).max(axis=-1) for name in ("pncc", "offset")]
            + [np.abs(rendered["depth"] - expected["depth"])],
            axis=0,
        )
        self.inside += int(both.sum())
        self.off += int((error[both] > LIMIT_MM).sum())
        smooth = both & ~near_fold(expected)
        self.smooth += int(smooth.sum())
        self.worst_on_smooth_mm = max(self.worst_on_smooth_mm, float(error[smooth].max(initial=0)))


def near_fold(maps: dict[str, ndarray]) -> ndarray:
    """Pixels beside another sheet of the surface or the background."""
    depth = np.where(np.isfinite(maps["surface_depth"]), maps["surface_depth"], 1e4)[..., None]
    values = np.concatenate([depth, maps["pncc"]], axis=-1)
    step = ndimage.maximum_filter(values, (3, 3, 1)) - ndimage.minimum_filter(values, (3, 3, 1))
    return np.asarray((step > FOLD_MM_PX / len(depth)).any(axis=-1))


def faces(model: MorphableModel, n: int, size: int) -> list[tuple[ndarray, Camera]]:
    """Faces with expressions, wide poses and near cameras; every other one through its affine approximation."""
    table = sample_faces(model, n, 7, size)
    vertices = model.vertices(table.identity, table.expression)
    cameras = [Camera(matrix) for matrix in table.cameras]
    return [(vertices[i], linearised(camera) if i % 2 else camera) for i, camera in enumerate(cameras)]


@pytest.mark.parametrize("size", [128, 256])
def test_maps_equal_those_of_the_oracle(gl: GLContext, size: int) -> None:
    model, found = builtin_model(), Comparison()
    renderer = Renderer(model, size, size, gl)
    for vertices, camera in faces(model, 20, size):
        found.add(renderer.render(vertices, camera), render_maps(model, vertices, camera, size, size))
    assert found.border > 10_000
    assert found.mask_differs <= 0.001 * found.border
    assert found.off <= 1e-4 * found.inside
    assert found.smooth > 0.5 * found.inside
    assert found.worst_on_smooth_mm <= LIMIT_MM


def test_the_comparison_notices_a_twentieth_of_a_pixel(gl: GLContext) -> None:
    """The test above can fail: a picture shifted by a twentieth of a pixel is not the same."""
    model, found = builtin_model(), Comparison()
    renderer = Renderer(model, 128, 128, gl)
    shift = np.array([[1.0, 0, 0.05], [0, 1, 0], [0, 0, 1]])
    for vertices, camera in faces(model, 4, 128):
        found.add(renderer.render(vertices, camera.transformed(shift)), render_maps(model, vertices, camera, 128, 128))
    assert found.mask_differs > 0.001 * found.border
    assert found.off > 1e-4 * found.inside


def test_pictures_need_not_be_square_and_sizes_share_the_model(gl: GLContext) -> None:
    model = small_head_model()
    camera = weak_perspective_camera(WeakPerspective(0.3, rotation_of_pose(HeadPose(0, 20, 0)), np.array([60.0, 30])))
    first = Renderer(model, 64, 64, gl)
    for height, width in ((64, 120), (120, 64), (33, 71)):
        rendered = first.with_size(height, width).render(model.mean, camera)
        expected = render_maps(model, model.mean, camera, height, width)
        assert rendered["mask"].shape == (height, width)
        assert (rendered["mask"] != expected["mask"]).sum() <= 1
        error = np.abs(rendered["pncc"] - expected["pncc"])[rendered["mask"] & expected["mask"]]
        assert np.quantile(error, 0.999) < LIMIT_MM


def test_a_mirrored_camera_renders_the_mirrored_maps(gl: GLContext) -> None:
    model = small_head_model()
    camera = weak_perspective_camera(WeakPerspective(0.3, rotation_of_pose(HeadPose(0, 40, 0)), np.full(2, 32.0)))
    renderer = Renderer(model, 64, 64, gl)
    straight = renderer.render(model.mean, camera)
    mirrored = renderer.render(model.mean, camera.transformed(np.array([[-1.0, 0, 64], [0, 1, 0], [0, 0, 1]])))
    assert (mirrored["mask"][:, ::-1] != straight["mask"]).sum() <= 2
    both = mirrored["mask"][:, ::-1] & straight["mask"]
    assert np.abs(mirrored["pncc"][:, ::-1] - straight["pncc"])[both].max() < 0.05


def test_the_far_ear_is_hidden_by_the_head(gl: GLContext) -> None:
    model = builtin_model()
    camera = weak_perspective_camera(WeakPerspective(0.8, rotation_of_pose(HeadPose(0, 90, 0)), np.full(2, 128.0)))
    rendered = Renderer(model, 256, 256, gl).render(model.mean, camera)
    assert rendered["mask"].sum() > 5000
    # The face looks to the picture's left, so the subject's left half (x > 0) is the near one.
    assert (rendered["pncc"][rendered["mask"]][:, 0] > -8).mean() > 0.99
    landmarks = model.landmarks[IBUG68]
    visible = visible_landmarks(model.mean, landmarks, camera, rendered["surface_depth"])
    assert visible[[12, 14, 16, 45, 54]].all()
    assert not visible[[0, 2, 4, 36, 48]].any()


def test_landmarks_outside_the_picture_are_not_visible(gl: GLContext) -> None:
    model = builtin_model()
    camera = weak_perspective_camera(WeakPerspective(0.8, rotation_of_pose(HeadPose(0, 0, 0)), np.array([128.0, 10])))
    rendered = Renderer(model, 256, 256, gl).render(model.mean, camera)
    landmarks = model.landmarks[IBUG68]
    outside = camera.project(model.mean[landmarks])[:, 1] < 0
    assert outside.any()
    assert not visible_landmarks(model.mean, landmarks, camera, rendered["surface_depth"])[outside].any()


def test_impossible_requests_are_named(gl: GLContext) -> None:
    model = small_head_model()
    renderer = Renderer(model, 32, 32, gl)
    with pytest.raises(UsageError, match="expected images of 1 to"):
        renderer.with_size(0, 32)
    with pytest.raises(UsageError, match="expected images of 1 to"):
        renderer.with_size(32, 1_000_000)
    near = Camera(np.array([[50.0, 0, 16, 320], [0, -50, 16, 320], [0, 0, -1, 20], [0, 0, -1, 20]]))
    with pytest.raises(DegenerateGeometryError, match="in front of the camera"):
        renderer.render(model.mean, near)
