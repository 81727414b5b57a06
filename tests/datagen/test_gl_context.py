"""Contexts: EGL and OSMesa give the same maps; where neither is there, one line says so."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from datagen import gl_context
from datagen.cli import main
from datagen.gl_context import create_gl_context
from datagen.sampling import sample_faces
from pix2face.coefficients import save_coefficients
from pix2face.errors import GLUnavailableError, UsageError
from pix2face.morphable_model import load_model
from tests.model_files import write_small_head

SIZE = 128
RENDER = f"""
import sys
import numpy as np
from datagen.gl_context import create_gl_context
from datagen.renderer import Renderer
from datagen.sampling import sample_faces
from pix2face.camera import Camera
from pix2face.errors import GLUnavailableError
from pix2face.morphable_model import builtin_model
model = builtin_model()
table = sample_faces(model, 6, 3, {SIZE})
vertices = model.vertices(table.identity, table.expression)
try:
    gl = create_gl_context()
except GLUnavailableError as error:
    sys.exit(f"no context: {{error}}")
with gl:
    renderer = Renderer(model, {SIZE}, {SIZE}, gl)
    maps = [renderer.render(v, Camera(m)) for v, m in zip(vertices, table.cameras)]
np.savez(sys.argv[1], backend=gl.backend, **{{
    name: np.stack([getattr(m, name) for m in maps]) for name in ("pncc", "offset", "mask", "depth")
}})
"""


def rendered_by(backend: str, folder: Path) -> dict[str, np.ndarray]:
    """Maps of six faces by one backend, in a process of its own: both in one would share dispatch tables."""
    out = folder / f"{backend}.npz"
    environment = {**os.environ, "PIX2FACE_GL": backend}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", RENDER, str(out)], env=environment, capture_output=True, text=True
    )
    if done.returncode and "no context" in done.stderr:
        pytest.skip(f"{backend}: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    with np.load(out, allow_pickle=False) as arrays:
        found = dict(arrays)
    assert str(found["backend"]) == backend
    return found


@pytest.mark.gl
def test_egl_and_osmesa_render_the_same(tmp_path: Path) -> None:
    egl, osmesa = (rendered_by(backend, tmp_path) for backend in ("egl", "osmesa"))
    both = egl["mask"] & osmesa["mask"]
    assert both.sum() > 10_000
    assert (egl["mask"] != osmesa["mask"]).sum() <= 2
    for name in ("pncc", "offset", "depth"):
        assert np.abs(egl[name] - osmesa[name])[both].max() < 1 / 128


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
    monkeypatch.setattr(gl_context, "OSMESA_LIBRARIES", ("libNoOSMesa.so.9",))
    with pytest.raises(GLUnavailableError, match=r"osmesa: libNoOSMesa\.so\.9"):
        create_gl_context("osmesa")


def test_rendering_without_gl_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Through the command and its worker processes, with a driver that does not exist."""
    model = load_model(write_small_head(tmp_path / "model.h5"))
    save_coefficients(sample_faces(model, 2, 0, 32), tmp_path / "faces.h5")
    monkeypatch.setenv("PIX2FACE_GL", "egl")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", str(tmp_path / "nothing.json"))
    arguments = ["render", "--coeffs", str(tmp_path / "faces.h5"), "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main([*arguments, "--model", str(tmp_path / "model.h5")]) == 2
    last = capfd.readouterr().err.strip().splitlines()[-1]
    assert last.startswith("datagen: error: expected OpenGL 3.3 without a display, found none (egl: ")
    assert list((tmp_path / "out").glob("*")) == []
