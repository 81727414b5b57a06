"""Choice of the rasteriser, several contexts in a process, and all of it by both back ends."""

import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from datagen.appearance.plain_appearance import draw_plain_appearance
from datagen.opengl.gl_context import GLContext, GLSettings, create_gl_context
from datagen.rendering.renderer import Renderer
from datagen.sampling.faces import sample_faces
from pix2face.errors import GLUnavailableError
from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.models.morphable_model import builtin_model
from pix2face.models.rasterise import render_maps
from tests.synthetic_models import small_head_model

pytestmark = [pytest.mark.gl, pytest.mark.xdist_group("maps by back ends")]  # which are rendered once

CAMERA = weak_perspective_camera(WeakPerspective(0.3, rotation_of_pose(HeadPose(0, 30, 0)), np.full(2, 32.0)))
RENDER = """
import sys
import numpy as np
from datagen.opengl.gl_context import create_gl_context
from datagen.rendering.renderer import Renderer
from datagen.sampling.faces import sample_faces
from pix2face.geometry.camera import Camera
from pix2face.errors import GLUnavailableError
from pix2face.models.morphable_model import builtin_model
model = builtin_model()
table = sample_faces(model, 6, 3, 192)
vertices = model.vertices(table.identity, table.expression)
faces = [(v, Camera(m)) for v, m in zip(vertices, table.cameras)]
try:
    gl = create_gl_context()
    renderer = Renderer(model, 192, 192, gl)
except GLUnavailableError as error:
    sys.exit(f"not here: {error}")
assert renderer.rasteriser == "compute", renderer.rasteriser
maps = [renderer.render(v, c) for v, c in faces]
np.savez(sys.argv[1], **{name: np.stack([m[name] for m in maps]) for name in ("pncc", "offset", "mask")})
"""


@cache
def rendered_by(backend: str, threads: int) -> dict[str, np.ndarray]:
    environment = {"PIX2FACE_GL": backend, "PIX2FACE_RASTERISER": "compute", "LP_NUM_THREADS": str(threads)}
    with TemporaryDirectory() as folder:
        out = Path(folder) / "maps.npz"
        command = [sys.executable, "-W", "error", "-c", RENDER, str(out)]
        done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)
        if done.returncode and "not here" in done.stderr:
            pytest.skip(f"{backend}: {done.stderr.strip()}")
        assert done.returncode == 0, done.stderr
        with np.load(out, allow_pickle=False) as arrays:
            return dict(arrays)


@pytest.fixture(scope="module")
def truth() -> dict[str, np.ndarray]:
    model = builtin_model()
    table = sample_faces(model, 6, 3, 192)
    vertices = model.vertices(table.identity, table.expression)
    maps = [render_maps(model, v, Camera(m), 192, 192) for v, m in zip(vertices, table.cameras, strict=True)]
    return {name: np.stack([own[name] for own in maps]) for name in ("pncc", "offset", "mask")}


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_each_back_end_renders_the_same(truth: dict[str, np.ndarray], backend: str) -> None:
    """Within a step of the fixed point of each other: half a step from the oracle."""
    found = rendered_by(backend, 4)
    both = found["mask"] & truth["mask"]
    assert both.sum() > 50_000
    assert (found["mask"] != truth["mask"]).sum() <= 1e-4 * both.sum()
    for name in ("pncc", "offset"):
        error = np.abs(found[name] - truth[name]).max(axis=-1)[both]
        assert (error > 0.5 / 128).sum() <= 1e-4 * both.sum()


def test_threads_do_not_change_a_byte() -> None:
    several = rendered_by("egl", 4)
    for name, values in rendered_by("egl", 0).items():
        assert values.tobytes() == several[name].tobytes()


def test_the_choice_follows_capability_and_can_be_forced(gl: GLContext) -> None:
    model = small_head_model()
    software, gpu = (replace(gl, rasteriser="auto", renderer=name) for name in ("llvmpipe (LLVM 15)", "GeForce"))
    assert Renderer(model, 16, 16, software).rasteriser == "processor"
    assert Renderer(model, 16, 16, gpu).rasteriser == ("compute" if gl.version_code >= 430 else "processor")
    assert Renderer(model, 16, 16, replace(gpu, rasteriser="processor")).rasteriser == "processor"
    assert Renderer(model, 16, 16, gpu, "processor").rasteriser == "processor"
    old = replace(gpu, version_code=330)
    assert Renderer(model, 16, 16, old).rasteriser == "processor"
    for context, found in ((old, r"3\.3"), (None, "none")):
        with pytest.raises(GLUnavailableError, match=rf"OpenGL 4\.3 for the rasteriser compute, found {found}"):
            Renderer(model, 16, 16, context, "compute")


def test_without_opengl_there_are_maps_and_no_pictures() -> None:
    model = small_head_model()
    renderer = Renderer(model, 64, 64)
    assert renderer.rasteriser == "processor"
    assert renderer.render(model.mean, CAMERA)["mask"].any()
    background = np.zeros((64, 64, 3), np.uint8)
    with pytest.raises(GLUnavailableError, match="expected OpenGL, which draws pictures, found a renderer without"):
        renderer.render_image(model.mean, CAMERA, draw_plain_appearance(np.random.default_rng(0)), background)


def test_two_contexts_in_a_process_do_not_disturb_each_other(gl: GLContext) -> None:
    if gl.version_code < 430:
        pytest.skip("no compute shaders in this OpenGL")
    model = small_head_model()
    first = Renderer(model, 64, 64, gl, "compute")
    expected = first.render(model.mean, CAMERA, ("normals",))
    other = create_gl_context(GLSettings(gl.backend))
    second = Renderer(model, 48, 64, other, "compute")
    for _ in range(2):
        assert second.render(model.mean, CAMERA)["mask"].sum() > 500
        again = first.render(model.mean, CAMERA, ("normals",))
        np.testing.assert_array_equal(again["pncc"], expected["pncc"])
        np.testing.assert_array_equal(again["normals"], expected["normals"])
    assert other.context.error == "GL_NO_ERROR"
    other.release()
    np.testing.assert_array_equal(first.render(model.mean, CAMERA)["offset"], expected["offset"])
    np.testing.assert_array_equal(
        first.with_size(40, 40).render(model.mean, CAMERA)["mask"], expected["mask"][:40, :40]
    )
