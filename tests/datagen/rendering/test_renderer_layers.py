"""Further layers against the oracle, by both rasterisers."""

from dataclasses import replace

import numpy as np
import pytest
from numpy import ndarray

from datagen.opengl.gl_context import GLContext
from datagen.rendering import map_drawing
from datagen.rendering.processor import processor_maps
from datagen.rendering.renderer import Renderer
from datagen.samples.sample_making import SampleMaker
from pix2face.errors import UsageError
from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    Pinhole,
    WeakPerspective,
    pinhole_camera,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.models import rasterise as oracle
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.models.rasterise import SURFACE_DEPTH, render_maps
from pix2face.models.surface_attributes import ATTRIBUTES, EXTRA_LAYERS, Attribute, camera_from_model_axes
from pix2face.shards.layers import LAYERS
from tests.meshes import mesh_model
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.gl

SIZE = 128
ALWAYS_RENDERED = {"pncc", "offset", "mask", "depth", SURFACE_DEPTH}
ROTATION = rotation_of_pose(HeadPose(-8, 40, 10))
AFFINE = weak_perspective_camera(WeakPerspective(0.45, ROTATION, np.array([61.3, 64.8])))
PINHOLE = pinhole_camera(Pinhole(250, np.array([64.0, 60]), ROTATION, np.array([5.0, -3, 520])))


@pytest.mark.parametrize("camera", [AFFINE, PINHOLE], ids=["affine", "pinhole"])
@pytest.mark.parametrize("rasteriser", ["processor", "compute"])
def test_they_equal_those_of_the_oracle(gl: GLContext, rasteriser: str, camera: Camera) -> None:
    if rasteriser == "compute" and gl.version_code < 430:
        pytest.skip("no compute shaders in this OpenGL")
    model = builtin_model()
    found = Renderer(model, SIZE, SIZE, gl, rasteriser).render(model.mean, camera, EXTRA_LAYERS)
    expected = render_maps(model, model.mean, camera, SIZE, SIZE, EXTRA_LAYERS)
    assert set(found) == set(expected) == {*ALWAYS_RENDERED, *EXTRA_LAYERS}
    for name in EXTRA_LAYERS:
        values, truth, layer = found[name], expected[name], LAYERS[name]
        assert values.shape == truth.shape == layer.shape(SIZE, SIZE)
        assert values.dtype == truth.dtype == np.dtype(layer.dtype)
        if name == "regions":
            assert (values != truth).sum() <= 3
            continue
        both = found["mask"] & expected["mask"]
        assert not values[~found["mask"]].any()
        assert np.quantile(np.abs(values - truth)[both], 0.9999) < 0.5 / layer.steps_per_unit


def test_normals_are_unit_vectors_that_face_the_camera(gl: GLContext) -> None:
    model = builtin_model()
    camera = weak_perspective_camera(WeakPerspective(0.45, rotation_of_pose(HeadPose(0, 0, 0)), np.full(2, 64.0)))
    rendered = Renderer(model, SIZE, SIZE, gl).render(model.mean, camera, ("normals",))
    normals = rendered["normals"][rendered["mask"]]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    assert (normals[:, 2] < 0).mean() > 0.97  # z runs away from the camera
    # The subject's left cheek is on the picture's right, and looks there; the forehead looks up, which is -y.
    right = rendered["normals"][64, 100]
    assert right[0] > 0.3
    low, high = np.flatnonzero(rendered["mask"][:, 64])[[-3, 3]]
    assert rendered["normals"][low, 64, 1] > 0 > rendered["normals"][high, 64, 1]


def test_a_mirrored_camera_mirrors_the_normals(gl: GLContext) -> None:
    mirror = np.array([[-1.0, 0, SIZE], [0, 1, 0], [0, 0, 1]])
    renderer = Renderer(small_head_model(), SIZE, SIZE, gl)
    for camera in (AFFINE, PINHOLE):
        straight, mirrored = (
            renderer.render(small_head_model().mean, each, ("normals",))
            for each in (camera, camera.transformed(mirror))
        )
        assert np.linalg.det(camera_from_model_axes(camera.transformed(mirror))) < 0
        both = straight["mask"] & mirrored["mask"][:, ::-1]
        flipped = mirrored["normals"][:, ::-1] * [-1, 1, 1]
        assert np.quantile(np.abs(flipped - straight["normals"])[both], 0.999) < 1e-3


def test_regions_hold_on_the_whole_head(gl: GLContext) -> None:
    model = small_head_model()
    rendered = Renderer(model, SIZE, SIZE, gl).render(model.mean, AFFINE, ("regions",))
    regions = rendered["regions"]
    np.testing.assert_array_equal(regions > 0, np.isfinite(rendered["surface_depth"]))
    face = [1 + model.region_names.index(name) for name in model.face_regions]
    assert np.isin(regions[rendered["mask"]], face).all()
    assert (regions == 1 + model.region_names.index("scalp")).sum() > 200


def test_texture_coordinates_may_split_at_vertices(gl: GLContext) -> None:
    """Each triangle has its own, as along a seam."""
    model = small_head_model()
    corners = model.triangles.reshape(-1)
    rng = np.random.default_rng(2)
    uv = rng.uniform(size=(len(corners), 2)).astype(np.float32)
    split = replace(model, uv=uv, uv_triangles=np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
    found = Renderer(split, SIZE, SIZE, gl).render(model.mean, AFFINE, ("uv",))
    expected = render_maps(split, model.mean, AFFINE, SIZE, SIZE, ("uv",))
    both = found["mask"] & expected["mask"]
    assert np.quantile(np.abs(found["uv"] - expected["uv"])[both], 0.999) < 1e-3


def test_a_model_without_texture_coordinates_is_named(gl: GLContext) -> None:
    model = mesh_model(small_head_model().mean, small_head_model().triangles)
    with pytest.raises(UsageError, match="texture coordinates for the layer uv, found a mesh without; leave uv out"):
        Renderer(model, 32, 32, gl).render(model.mean, AFFINE, ("uv",))
    with pytest.raises(UsageError, match="texture coordinates for the layer uv, found a mesh without; leave uv out"):
        render_maps(model, model.mean, AFFINE, 32, 32, ("uv",))
    with pytest.raises(UsageError, match="texture coordinates for the layer uv"):
        SampleMaker(model, gl, 0, ("uv",))  # before any sample is tried


def test_what_was_not_asked_for_is_not_there(gl: GLContext) -> None:
    model = small_head_model()
    renderer = Renderer(model, 32, 32, gl)
    assert set(renderer.render(model.mean, AFFINE)) == ALWAYS_RENDERED
    assert set(renderer.render(model.mean, AFFINE, ("image", "pncc", "normals"))) == {*ALWAYS_RENDERED, "normals"}


@pytest.mark.parametrize("rasteriser", ["processor", "compute"])
def test_a_new_attribute_is_one_entry_of_the_table(
    gl: GLContext, rasteriser: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def heights(model: MorphableModel, vertices: ndarray, camera: Camera) -> ndarray:
        return np.ascontiguousarray(vertices[:, 1:2])

    table = {**ATTRIBUTES, "height": Attribute(1, heights, lambda model: model.triangles)}
    monkeypatch.setattr(map_drawing, "ATTRIBUTES", table)
    monkeypatch.setattr(oracle, "ATTRIBUTES", table)
    monkeypatch.setattr(processor_maps, "ATTRIBUTES", table)
    model = small_head_model()
    found = Renderer(model, SIZE, SIZE, gl, rasteriser).render(model.mean, AFFINE, ("height",))
    expected = render_maps(model, model.mean, AFFINE, SIZE, SIZE, ("height",))
    both = found["mask"] & expected["mask"]
    assert np.abs(found["height"] - expected["height"])[both].max() < 0.05
    np.testing.assert_allclose(found["height"][both][:, 0], (found["pncc"] + found["offset"])[both][:, 1], atol=0.05)
