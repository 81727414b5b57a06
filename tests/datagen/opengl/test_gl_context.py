"""Contexts: which are opened, by option, environment and capability; where none is there, one line says so."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from multiprocessing.reduction import ForkingPickler
from pathlib import Path

import cv2
import numpy as np
import pytest

from datagen.cli import main
from datagen.opengl import gl_context
from datagen.opengl.egl_devices import EGLDevice
from datagen.opengl.gl_context import GLSettings, create_gl_context
from datagen.opengl.osmesa_context import OSMESA_LIBRARIES, load_osmesa
from datagen.opengl.rasteriser_choice import choose_rasteriser, has_gpu_files, open_context
from datagen.sampling.faces import sample_faces
from pix2face.errors import GLUnavailableError, UsageError
from pix2face.face_files.coefficients import save_coefficients
from pix2face.models.morphable_model import load_model
from tests.model_files import write_small_head


def test_an_unknown_backend_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIX2FACE_GL", "vulkan")
    with pytest.raises(UsageError, match="PIX2FACE_GL: expected one of egl, osmesa, found 'vulkan'"):
        create_gl_context()


def fail(*_: object) -> None:
    raise OSError("libNothing.so: cannot open shared object file")


def test_without_any_library_one_line_names_each_complaint_and_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PIX2FACE_GL", raising=False)
    monkeypatch.setattr(gl_context, "_CREATORS", {"egl": fail, "osmesa": fail})
    with pytest.raises(GLUnavailableError) as caught:
        create_gl_context()
    message = str(caught.value)
    assert "\n" not in message
    for part in ("egl: libNothing.so", "osmesa: libNothing.so", "libegl1", "libosmesa6"):
        assert part in message


def test_osmesa_alone_says_that_its_library_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl_context, "load_osmesa", lambda: load_osmesa(("libNoOSMesa.so.9", "libNoOSMesa.so")))
    with pytest.raises(GLUnavailableError, match=r"osmesa: libNoOSMesa\.so\.9"):
        create_gl_context("osmesa")


def test_what_is_left_open_comes_from_the_environment() -> None:
    environment = {"PIX2FACE_GL": "egl", "PIX2FACE_GL_DEVICE": "1", "PIX2FACE_RASTERISER": "processor"}
    assert GLSettings().resolved(environment) == GLSettings("egl", 1, "processor")
    assert GLSettings("egl", 0, "compute").resolved(environment) == GLSettings("egl", 0, "compute")
    assert GLSettings().resolved(dict.fromkeys(environment, "")) == GLSettings()
    assert GLSettings().resolved({"GLCONTEXT_DEVICE_INDEX": "1"}) == GLSettings()


@pytest.mark.parametrize(
    ("settings", "environment", "message"),
    [
        (GLSettings("vulkan"), {}, "backend: expected one of egl, osmesa, found 'vulkan'"),
        (GLSettings(), {"PIX2FACE_RASTERISER": "cpu"}, "PIX2FACE_RASTERISER: expected one of auto, processor, compute"),
        (GLSettings(), {"PIX2FACE_GL_DEVICE": "first"}, "PIX2FACE_GL_DEVICE: expected the number of a device, from 0"),
        (GLSettings(device=-1), {}, "device: expected the number of a device, from 0, found -1"),
        (GLSettings("osmesa", 0), {}, "expected no device with the backend osmesa"),
        (GLSettings(device=0), {"PIX2FACE_GL": "osmesa"}, "expected no device with the backend osmesa"),
        (GLSettings(device=0), {"GLCONTEXT_DEVICE_INDEX": "1"}, "found 0 and GLCONTEXT_DEVICE_INDEX=1; unset it"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings: GLSettings, environment: dict[str, str], message: str) -> None:
    with pytest.raises(UsageError, match=re.escape(message)):
        settings.resolved(environment)


def test_settings_travel_to_workers() -> None:
    settings = GLSettings("egl", 1, "processor")
    assert ForkingPickler.loads(ForkingPickler.dumps(settings)) == settings


def test_compute_shaders_are_taken_on_a_gpu_that_has_them() -> None:
    for version, expected in ((0, "processor"), (330, "processor"), (420, "processor"), (430, "compute")):
        assert choose_rasteriser("auto", version, is_software=False) == expected
        assert choose_rasteriser("auto", version, is_software=True) == "processor"
    assert choose_rasteriser("processor", 460, is_software=False) == "processor"
    assert choose_rasteriser("compute", 430, is_software=True) == "compute"
    for version, found in ((330, r"3\.3"), (0, "none")):
        with pytest.raises(GLUnavailableError, match=rf"4\.3 for the rasteriser compute, found {found}; choose"):
            choose_rasteriser("compute", version, is_software=False)


def test_maps_need_no_opengl_without_a_gpu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PIX2FACE_GL", "PIX2FACE_GL_DEVICE", "PIX2FACE_RASTERISER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(gl_context, "_CREATORS", {"egl": fail, "osmesa": fail})
    assert open_context(GLSettings(), draws_pictures=False, root=tmp_path) is None
    assert open_context(GLSettings("egl", rasteriser="processor"), draws_pictures=False, root=tmp_path) is None
    asked_for = (GLSettings("egl"), GLSettings(rasteriser="compute"))
    for settings, draws_pictures in ((GLSettings(), True), *((settings, False) for settings in asked_for)):
        with pytest.raises(GLUnavailableError):
            open_context(settings, draws_pictures=draws_pictures, root=tmp_path)
    (tmp_path / "dev" / "dri").mkdir(parents=True)
    (tmp_path / "dev" / "dri" / "renderD128").touch()
    assert open_context(GLSettings(), draws_pictures=False, root=tmp_path) is None  # a GPU without a driver


def test_a_device_that_is_not_there_is_refused_with_those_that_are(monkeypatch: pytest.MonkeyPatch) -> None:
    card = EGLDevice(0, "NVIDIA (EGL 1.5)", ("EGL_NV_device_cuda",), "/dev/dri/renderD128")
    monkeypatch.setattr(gl_context, "egl_devices", lambda: [card])
    monkeypatch.setattr(gl_context, "count_egl_devices", lambda: 1)
    monkeypatch.delenv("PIX2FACE_GL", raising=False)
    with pytest.raises(
        UsageError, match=r"one of the 1 .*\(0: NVIDIA .*CUDA, /dev/dri/renderD128\), found 1; `datagen"
    ):
        create_gl_context(GLSettings(device=1))


def in_a_process(code: str, **environment: str) -> str:
    """What a program prints; skips the test where its backend is not to be had."""
    code = "import sys\nfrom datagen.opengl.gl_context import *\nfrom pix2face.errors import *\n" + code
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], env={**os.environ, **environment}, capture_output=True, text=True
    )
    if "GLUnavailableError: expected OpenGL 3.3 without a display" in done.stderr:
        pytest.skip(done.stderr.strip().splitlines()[-1])
    assert done.returncode == 0, done.stderr
    return done.stdout


TWO_CONTEXTS = """
def works(gl):
    gl.make_current()
    buffer = gl.context.buffer(b"1234")
    found = buffer.read(), gl.context.error
    return found == (b"1234", "GL_NO_ERROR")
first, second, third = (create_gl_context() for _ in range(3))
print(works(second), works(first), works(third), works(first))
third.release()
print(first.context.buffer(b"12").read(), first.context.error)  # an owner who never heard of the others
first.release()
first.release()
print(works(second), second.version_code >= 330)
second.release()
print(works(create_gl_context()))
"""


@pytest.mark.gl
@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_releasing_one_of_several_contexts_leaves_the_others_whole(backend: str) -> None:
    expected = "True True True True\nb'12' GL_NO_ERROR\nTrue True\nTrue\n"
    assert in_a_process(TWO_CONTEXTS, PIX2FACE_GL=backend) == expected


@pytest.mark.gl
def test_the_first_device_can_be_asked_for() -> None:
    code = "gl = create_gl_context(GLSettings(device=0)); print(gl.backend, gl.device, gl.version_code // 100 >= 3)"
    assert in_a_process(code, PIX2FACE_GL="egl") == "egl 0 True\n"


@pytest.mark.gl
@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_an_older_driver_is_taken_as_it_is(backend: str) -> None:
    """Mesa can be told to be older than it is."""
    code = "print(create_gl_context().version_code)"
    if "Mesa" not in in_a_process("print(create_gl_context().context.info['GL_VERSION'])", PIX2FACE_GL=backend):
        pytest.skip("the driver is not Mesa's")
    assert in_a_process(code, PIX2FACE_GL=backend, MESA_GL_VERSION_OVERRIDE="3.3") == "330\n"


def test_rendering_without_gl_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Through the command and its worker processes, with a driver that does not exist."""
    model = load_model(write_small_head(tmp_path / "model.h5"))
    save_coefficients(sample_faces(model, 2, 0, 32), tmp_path / "faces.h5")
    monkeypatch.setenv("PIX2FACE_GL", "egl")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", str(tmp_path / "nothing.json"))
    arguments = ["render", "--coeffs", str(tmp_path / "faces.h5"), "--out", str(tmp_path / "out"), "--workers", "2"]
    assert main([*arguments, "--model", str(tmp_path / "model.h5")]) == 2
    last = capfd.readouterr().err.strip().splitlines()[-1]
    assert last.startswith("datagen: error: expected OpenGL 3.3 without a display, found none (egl: ")
    assert list((tmp_path / "out").glob("*")) == []


def test_faces_with_photographs_render_on_a_machine_without_opengl(tmp_path: Path) -> None:
    """The whole command in a process whose loader finds empty files instead of EGL and OSMesa."""
    if has_gpu_files():
        pytest.skip("this machine has a GPU, which is tried first")
    for name in ("libEGL.so.1", "libGL.so.1", *OSMESA_LIBRARIES):
        (tmp_path / name).write_bytes(b"")
    model = load_model(write_small_head(tmp_path / "model.h5"))
    cv2.imwrite(str(tmp_path / "photograph.jpg"), np.full((32, 32, 3), 99, np.uint8))
    table = replace(sample_faces(model, 3, 0, 32), image_paths=("photograph.jpg",) * 3)
    save_coefficients(table, tmp_path / "faces.h5")
    arguments = ["render", "--coeffs", "faces.h5", "--model", "model.h5", "--out", "out", "--workers", "1"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PIX2FACE_")}
    done = subprocess.run(
        [sys.executable, "-m", "datagen.cli", *arguments],
        env={**environment, "LD_LIBRARY_PATH": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[3])},
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "3 triplets in 1 shard" in done.stderr
