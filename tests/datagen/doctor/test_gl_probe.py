"""The doctor here: a wrong render is noticed, a driver that dies is survived, the command reports."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from datagen.cli import main
from datagen.doctor import doctor_cli, gl_probe
from datagen.doctor.gl_probe import (
    PROCESSOR,
    BackendProbe,
    check_rendering,
    devices_apart,
    probe_backend,
    probe_backend_apart,
)
from datagen.opengl import Rasteriser
from datagen.opengl.gl_context import COMPUTE_VERSION, GLContext, GLSettings
from datagen.opengl.osmesa_context import OSMESA_LIBRARIES
from datagen.rendering.renderer import Renderer
from pix2face.geometry.camera import Camera


@pytest.fixture(params=["processor", "compute"])
def rasteriser(request: pytest.FixtureRequest, gl: GLContext) -> Rasteriser:
    if request.param == "compute" and gl.version_code < COMPUTE_VERSION:
        pytest.skip("no compute shaders")
    return request.param


@pytest.mark.gl
def test_the_render_of_this_machine_is_right(gl: GLContext, rasteriser: Rasteriser) -> None:
    found = check_rendering(gl, rasteriser)
    assert found.rasteriser == rasteriser
    assert found.mask_px > 10_000
    assert found.is_right


@pytest.mark.gl
def test_a_render_that_is_a_tenth_of_a_pixel_off_is_noticed(
    gl: GLContext, rasteriser: Rasteriser, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The check can fail."""
    right = Renderer.render
    shift = np.array([[1.0, 0, 0.1], [0, 1, 0], [0, 0, 1]])

    def shifted(self: Renderer, vertices: np.ndarray, camera: Camera) -> dict[str, np.ndarray]:
        return right(self, vertices, camera.transformed(shift))

    monkeypatch.setattr(Renderer, "render", shifted)
    assert not check_rendering(gl, rasteriser).is_right


def test_a_driver_that_ends_its_process_is_a_failure_like_any_other(monkeypatch: pytest.MonkeyPatch) -> None:
    crash = "import os, signal, sys; sys.stderr.write('LLVM ERROR: no\\n'); sys.stderr.flush(); "
    for code, message in (
        (crash + "os.kill(os.getpid(), signal.SIGSEGV)", "the driver ended its process (SIGSEGV): LLVM ERROR: no"),
        (crash + "sys.exit(1)", "the test process failed: LLVM ERROR: no"),
        ("import sys; sys.exit(1)", "the test process failed: it said nothing"),
        ("import time; time.sleep(60)", "no answer in 1 seconds"),
    ):
        monkeypatch.setattr(gl_probe, "SECONDS_AT_MOST", 1 if "sleep" in code else 60)
        monkeypatch.setattr(gl_probe, "PROGRAM", code)
        assert probe_backend_apart(GLSettings("egl")) == BackendProbe("egl", message)
        assert devices_apart() == ((), message)


def leave_out(monkeypatch: pytest.MonkeyPatch, probe: Callable[[GLSettings], BackendProbe], *backends: str) -> None:
    """Lets the command probe no more than the other backends: each takes a process of its own unless told otherwise."""

    def probed(settings: GLSettings) -> BackendProbe:
        backend = str(settings.backend)
        return BackendProbe(backend, "left out") if backend in backends else probe(settings)

    monkeypatch.setattr(doctor_cli, "probe_backend_apart", probed)


@pytest.mark.gl
def test_a_forced_backend_without_driver_ends_in_2_and_its_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The whole command, with a driver that does not exist."""
    leave_out(monkeypatch, probe_backend_apart, "osmesa", PROCESSOR)
    monkeypatch.setenv("PIX2FACE_GL", "egl")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", str(tmp_path / "nothing.json"))
    assert main(["doctor"]) == 2
    out = capsys.readouterr().out
    assert "error: egl: expected OpenGL 3.3 without a display, found none (egl: " in out
    assert "nothing.json is not there: unset __EGL_VENDOR_LIBRARY_FILENAMES or correct it" in out
    assert "not healthy" in out


@pytest.mark.gl
def test_libraries_that_cannot_be_loaded_are_found_out(tmp_path: Path) -> None:
    """The whole command in a process whose loader finds empty files first."""
    for name in ("libEGL.so.1", *OSMESA_LIBRARIES):
        (tmp_path / name).write_bytes(b"")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PIX2FACE_")}
    done = subprocess.run(
        [sys.executable, "-m", "datagen.cli", "doctor"],
        env={**environment, "LD_LIBRARY_PATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2, done.stderr
    assert done.stdout.count("error: ") == 2
    assert "error: egl: expected OpenGL 3.3 without a display, found none" in done.stdout
    assert "remedy: no libEGL (" in done.stdout
    assert "error: osmesa: expected OpenGL 3.3 without a display, found none" in done.stdout
    assert "remedy: apt-get install libosmesa6" in done.stdout
    assert "file too short" in done.stdout


@pytest.mark.gl
def test_the_doctor_reports_in_json(
    gl: GLContext, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    leave_out(monkeypatch, probe_backend, *({"egl", "osmesa"} - {gl.backend}))
    monkeypatch.setenv("PIX2FACE_GL_DEVICE", "")
    assert main(["doctor", "--gl", gl.backend, "--rasteriser", "processor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["healthy"] is True
    assert found["diagnosis"]["backend"] == gl.backend
    assert found["diagnosis"]["rasteriser"] == "processor"
    checks = {probe["backend"]: probe["checks"] for probe in found["backends"]}
    assert checks["processor"][0]["rasteriser"] == "processor"
    assert checks["processor"][0]["mask_px"] > 10_000
    assert checks[gl.backend][0]["rasteriser"] == "compute"
    assert found["versions"]["python"] == ".".join(map(str, sys.version_info[:3]))
    assert {"numpy", "numba", "moderngl", "h5py", "hdf5", "isal"} <= set(found["versions"])


def test_settings_that_cannot_be_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--gl", "vulkan"]) == 2
    assert capsys.readouterr().err == "datagen: error: backend: expected one of egl, osmesa, found 'vulkan'\n"
