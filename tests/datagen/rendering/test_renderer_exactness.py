"""Both rasterisers at every pixel centre: against ray casting, against the oracle, and where meshes are awkward."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy import ndarray

from datagen.opengl.gl_context import GLContext
from datagen.rendering.renderer import Renderer
from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    Pinhole,
    WeakPerspective,
    linearised,
    pinhole_camera,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.models.morphable_model import builtin_model
from pix2face.models.rasterise import rasterise, render_maps
from tests.benchmarks.exactness import LIMIT_MM, RENDERED, errors_mm, faces, rendering_errors
from tests.meshes import mesh_model, ray_casting, sheet, touching_lips
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.xdist_group("exactness")  # rays are cast and the oracle renders once

RASTERISERS = ("processor", pytest.param("compute", marks=pytest.mark.gl))
RAY_SIZE = 40
FRONTAL = rotation_of_pose(HeadPose(0, 0, 0))


@pytest.fixture(params=RASTERISERS)
def rasteriser(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def gl(request: pytest.FixtureRequest, rasteriser: str) -> Iterator[GLContext | None]:
    """The processor needs no OpenGL."""
    context = None if rasteriser == "processor" else request.getfixturevalue("gl_session")
    if context is not None and context.version_code < 430:
        pytest.skip("no compute shaders in this OpenGL")
    yield context
    assert context is None or context.context.error == "GL_NO_ERROR"


def frontal(scale: float, column: float, row: float) -> Camera:
    return weak_perspective_camera(WeakPerspective(scale, FRONTAL, np.array([column, row], dtype=np.float64)))


@pytest.mark.parametrize(("size", "n"), RENDERED)
def test_faces_equal_those_of_the_oracle(gl: GLContext | None, rasteriser: str, size: int, n: int) -> None:
    error, mask_differs = rendering_errors(gl, rasteriser, size, n)
    assert len(error) > 10_000
    assert error.max() <= LIMIT_MM
    assert mask_differs == 0


def test_the_comparison_notices_a_twentieth_of_a_pixel() -> None:
    model, shift = builtin_model(), np.array([[1.0, 0, 0.05], [0, 1, 0], [0, 0, 1]])
    ((vertices, camera),) = faces(model, 1, 200)
    found, expected = (render_maps(model, vertices, own, 200, 200) for own in (camera.transformed(shift), camera))
    assert errors_mm(found, expected).max() > LIMIT_MM
    assert (found["mask"] != expected["mask"]).any()


@lru_cache
def cast_rays(is_affine: bool) -> tuple[Camera, ndarray, ndarray, ndarray]:
    """A camera, a face, and what rays through the pixel centres hit of it."""
    model, pose = small_head_model(), HeadPose(12, 48, -9)
    pinhole = pinhole_camera(
        Pinhole(1.9 * RAY_SIZE, np.full(2, RAY_SIZE / 2), rotation_of_pose(pose), np.array([3.0, -4, 430]))
    )
    camera = linearised(pinhole) if is_affine else pinhole
    vertices = model.vertices(np.full((1, 12), 0.7), np.full((1, 6), -0.8))[0]
    return camera, vertices, *ray_casting(camera, vertices, model.triangles, RAY_SIZE)


@pytest.mark.parametrize("is_affine", [False, True], ids=["pinhole", "affine"])
def test_maps_equal_those_of_rays_through_the_pixel_centres(
    gl: GLContext | None, rasteriser: str, is_affine: bool
) -> None:
    pytest.importorskip("rtree", reason="trimesh casts rays through rtree")
    model = small_head_model()
    through, vertices, triangle, point = cast_rays(is_affine)
    found = Renderer(model, RAY_SIZE, RAY_SIZE, gl, rasteriser).render(vertices, through)
    hit = triangle >= 0
    assert (hit != np.isfinite(found["surface_depth"])).sum() <= 2  # rays through an edge may slip between triangles
    both = hit & found["mask"]
    assert both.sum() > 400
    error = np.abs(found["pncc"] + found["offset"] - point).max(axis=-1)[both]
    error = np.maximum(error, np.abs(found["depth"] - through.depth(point))[both])
    assert np.quantile(error, 0.999) <= LIMIT_MM
    # PNCC by barycentric weights of the point that was hit, with those of the mean.
    corners = model.triangles[triangle[both]]
    weights = np.linalg.solve(vertices[corners].astype(np.float64).transpose(0, 2, 1), point[both][..., None])
    pncc = (weights * model.mean[corners]).sum(axis=1)
    assert np.quantile(np.abs(found["pncc"][both] - pncc).max(axis=1), 0.999) <= LIMIT_MM


@pytest.mark.parametrize("gap_mm", [0.05, 1.0])
def test_the_nearer_of_two_touching_sheets_is_seen(gl: GLContext | None, rasteriser: str, gap_mm: float) -> None:
    """Lips pressed together: they cross each other, and at most 0.05 mm apart is less than a coarse depth."""
    model, vertices = touching_lips(gap_mm)
    camera = frontal(1.2, 64.2, 64.4)
    found = Renderer(model, 128, 128, gl, rasteriser).render(vertices, camera)
    expected = render_maps(model, vertices, camera, 128, 128)
    sheets = model.triangles[:-1]
    n_upper = 2 * 31 * 27
    upper, lower = (
        rasterise(camera.matrix, vertices, part, 128, 128).depth for part in (sheets[:n_upper], sheets[n_upper:])
    )
    apart = np.isfinite(upper) & np.isfinite(lower)
    # A coarse depth here is 20 m / 2^20 = 0.02 mm; float32's own steps at 20 m are 0.002 mm.
    apart[apart] = np.abs(upper[apart] - lower[apart]) > 0.002
    share = apart.mean()
    assert share > 0.3
    wrong = np.abs(found["pncc"] - expected["pncc"]).max(axis=-1) > 1
    assert wrong[apart].sum() == 0
    assert (expected["pncc"][apart][:, 2] < -10).mean() > 0.3  # both are in front somewhere
    assert (expected["pncc"][apart][:, 2] > -10).mean() > 0.3


@pytest.mark.parametrize("tilt_deg", [80, 88, 89.5])
def test_the_nearest_is_seen_at_grazing_angles(gl: GLContext | None, rasteriser: str, tilt_deg: float) -> None:
    points, triangles = sheet(20, 20)
    rng = np.random.default_rng(4)
    vertices = (points - [0.5, 0.5, 0]) * 150 + rng.normal(scale=0.5, size=points.shape)
    model = mesh_model(vertices, triangles)
    camera = weak_perspective_camera(
        WeakPerspective(0.8, rotation_of_pose(HeadPose(0, tilt_deg, 20)), np.array([64.0, 64]))
    )
    found = Renderer(model, 128, 128, gl, rasteriser).render(model.mean, camera)
    expected = render_maps(model, model.mean, camera, 128, 128)
    seen = np.isfinite(expected["surface_depth"])
    assert (np.isfinite(found["surface_depth"]) != seen).sum() == 0
    both = seen & np.isfinite(found["surface_depth"])
    error = np.abs(found["surface_depth"][both] - expected["surface_depth"][both])
    assert (error > 10 * LIMIT_MM).sum() == 0


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    columns=st.integers(1, 40),
    rows=st.integers(1, 40),
    shift=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    on_centres=st.booleans(),
)
def test_there_is_no_hole_between_triangles(
    gl: GLContext | None, rasteriser: str, columns: int, rows: int, shift: tuple[float, float], on_centres: bool
) -> None:
    """Also with vertices and edges on pixel centres, as ``on_centres`` has them."""
    points, triangles = sheet(columns, rows)
    size = 40
    vertices = points * [columns, rows, 0] if on_centres else (points - 0.5) * 50 + [20, 20, 0]
    model = mesh_model(vertices, triangles)
    offset = np.array([0.5, 0.5]) if on_centres else np.array(shift)
    camera = Camera(np.array([[1.0, 0, 0, offset[0]], [0, 1, 0, offset[1]], [0, 0, 1, 0], [0, 0, 0, 1]]))
    seen = np.isfinite(Renderer(model, size, size, gl, rasteriser).render(model.mean, camera)["surface_depth"])
    inside = np.s_[1 : min(rows, size), 1 : min(columns, size)] if on_centres else np.s_[:, :]
    assert seen[inside].all()


@pytest.mark.parametrize(
    ("height", "width", "camera"),
    [
        (90, 130, frontal(0.4, 20, 30)),
        (130, 70, frontal(0.5, 60, 120)),
        (64, 64, frontal(0.08, 40.3, 20.8)),
        (100, 100, frontal(8, 40, 20)),
    ],
    ids=["cut at the left", "cut at the bottom", "tiny", "larger than the picture"],
)
def test_any_place_and_size(gl: GLContext | None, rasteriser: str, height: int, width: int, camera: Camera) -> None:
    model = small_head_model()
    found = Renderer(model, height, width, gl, rasteriser).render(model.mean, camera)
    expected = render_maps(model, model.mean, camera, height, width)
    assert expected["mask"].sum() > 50
    assert (found["mask"] != expected["mask"]).sum() == 0
    assert np.quantile(errors_mm(found, expected), 0.995) <= LIMIT_MM
    assert (np.isfinite(found["surface_depth"]) != np.isfinite(expected["surface_depth"])).sum() <= 2


def test_a_face_beside_the_picture_leaves_it_empty(gl: GLContext | None, rasteriser: str) -> None:
    model = small_head_model()
    renderer = Renderer(model, 32, 48, gl, rasteriser)
    renderer.render(model.mean, frontal(0.2, 24, 16))  # what was seen before must not show
    for column, row in ((1000.0, 16.0), (24.0, -500.0), (-300.0, 900.0)):
        found = renderer.render(model.mean, frontal(0.2, column, row))
        assert not found["mask"].any()
        assert not found["pncc"].any()
        assert not found["offset"].any()
        assert not found["depth"].any()
        assert np.isinf(found["surface_depth"]).all()


def test_triangles_may_be_larger_than_the_screen_and_degenerate(gl: GLContext | None, rasteriser: str) -> None:
    model = small_head_model()
    huge = np.array([[-4000.0, -4000, -150], [5000, -4000, -150], [0, 6000, -150]])
    n = len(model.mean)
    flat = [[0, 0, 0], [5, 5, 9], [n, n, n + 1], [n, n + 1, n]]
    triangles = np.concatenate([flat, [[n, n + 1, n + 2]], model.triangles, flat])
    both = mesh_model(np.concatenate([model.mean, huge]), triangles)
    camera = frontal(0.25, 30.1, 33.7)
    found = Renderer(both, 64, 64, gl, rasteriser).render(both.mean, camera)
    expected = render_maps(both, both.mean, camera, 64, 64)
    assert expected["mask"].mean() > 0.99
    assert (found["mask"] != expected["mask"]).sum() == 0
    assert np.quantile(errors_mm(found, expected), 0.995) <= LIMIT_MM


def test_the_order_of_triangles_does_not_matter(gl: GLContext | None, rasteriser: str) -> None:
    model = small_head_model()
    shuffled = np.random.default_rng(3).permutation(len(model.triangles))
    other = replace(model, triangles=model.triangles[shuffled], triangle_regions=model.triangle_regions[shuffled])
    camera = weak_perspective_camera(WeakPerspective(0.5, rotation_of_pose(HeadPose(5, 60, 3)), np.full(2, 64.0)))
    first, second = (Renderer(each, 128, 128, gl, rasteriser).render(model.mean, camera) for each in (model, other))
    np.testing.assert_array_equal(first["mask"], second["mask"])
    np.testing.assert_allclose(first["pncc"], second["pncc"], atol=2e-3)
    np.testing.assert_allclose(first["depth"], second["depth"], atol=2e-3)


def test_the_same_face_gives_the_same_bytes(gl: GLContext | None, rasteriser: str) -> None:
    """Whatever was drawn between, and in whatever order threads ran."""
    model = builtin_model()
    renderer = Renderer(model, 200, 200, gl, rasteriser)
    (vertices, camera), (others, elsewhere) = faces(model, 2, 200)
    first = renderer.render(vertices, camera)
    for _ in range(3):
        renderer.render(others, elsewhere)
        renderer.with_size(64, 96).render(others, elsewhere)
        again = renderer.render(vertices, camera)
        for name in ("pncc", "offset", "mask", "depth", "surface_depth"):
            assert first[name].tobytes() == again[name].tobytes()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_vertices_that_are_not_finite_are_refused(gl: GLContext | None, rasteriser: str, bad: float) -> None:
    model = small_head_model()
    renderer = Renderer(model, 32, 32, gl, rasteriser)
    for camera in (frontal(0.1, 16, 16), _near_pinhole()):
        vertices = model.mean.copy()
        vertices[77, 1] = bad
        with pytest.raises(DegenerateGeometryError):
            renderer.render(vertices, camera)


def _near_pinhole() -> Camera:
    return pinhole_camera(Pinhole(60, np.full(2, 16.0), FRONTAL, np.array([0.0, 0, 300])))


def test_a_pinhole_with_another_depth_than_its_w_is_refused(gl: GLContext | None, rasteriser: str) -> None:
    matrix = _near_pinhole().matrix.copy()
    matrix[2] *= 2
    with pytest.raises(DegenerateGeometryError, match="whose depth is its w"):
        Renderer(small_head_model(), 32, 32, gl, rasteriser).render(small_head_model().mean, Camera(matrix))
