"""What OpenGL and the processor draw on this machine, compared with the oracle, each in a process of its own.

A broken driver may end its process, and two backends in one process would share their dispatch tables.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from datagen.opengl import Rasteriser
from datagen.opengl.egl_devices import EGLDevice, egl_devices
from datagen.opengl.gl_context import (
    COMPUTE_VERSION,
    DEVICE_VARIABLE,
    ENVIRONMENT_VARIABLE,
    RASTERISER_VARIABLE,
    REMEDY,
    GLContext,
    GLSettings,
    create_gl_context,
)
from datagen.rendering.renderer import Renderer
from datagen.sampling.faces import sample_faces
from pix2face.errors import Pix2FaceError
from pix2face.geometry.camera import Camera
from pix2face.models.morphable_model import builtin_model
from pix2face.models.rasterise import render_maps

SIZE_PX, N_FACES, SEED = 128, 4, 7
SECONDS_AT_MOST = 300
PROGRAM = "import sys; from datagen.doctor.gl_probe import answer; sys.stdout.write(answer(sys.argv[1]))"
# A pixel that is farther off shows another surface, or the driver computes something else.
LIMIT_MM = 0.02
PROCESSOR = "processor"  # in the place of a backend: no OpenGL
# The settings to be probed are resolved already: the other process must not resolve them again.
OUR_VARIABLES = (ENVIRONMENT_VARIABLE, DEVICE_VARIABLE, RASTERISER_VARIABLE)


@final
@dataclass(frozen=True)
class RenderCheck:
    """The built-in model drawn by one rasteriser, against the oracle."""

    rasteriser: str  # `processor` or `compute`
    error: str = ""  # why nothing was drawn; empty where it was
    mask_px: int = 0  # face pixels of the oracle
    mask_differs_px: int = 0  # pixels that are face to only one of the two
    off_px: int = 0  # face pixels of both, more than 0.02 mm apart: at folds rounding decides which surface is nearer
    typical_worst_mm: float = 0.0  # the largest difference of 99.9 % of the pixels of both
    milliseconds: float = 0.0  # shortest time of one picture

    @property
    def is_right(self) -> bool:
        """Whether the maps are the oracle's, except at folds and borders."""
        few = 0.002 * self.mask_px
        drawn = not self.error and self.mask_px > 0
        return drawn and self.mask_differs_px <= few and self.off_px <= few and self.typical_worst_mm <= LIMIT_MM


@final
@dataclass(frozen=True)
class BackendProbe:
    """What one backend does on this machine."""

    backend: str  # `egl`, `osmesa`, or `processor` for drawing without OpenGL
    error: str = ""  # why it makes no context; empty where it does
    renderer: str = ""  # the driver's name for itself
    gl_version: str = ""  # version of OpenGL and of the driver, in the driver's words
    version_code: int = 0  # 450 for OpenGL 4.5
    checks: tuple[RenderCheck, ...] = ()  # of `compute`, if this version has it, or of `processor`


def probe_backend(settings: GLSettings) -> BackendProbe:
    """Makes a context in this process and draws with it; with the backend ``processor``, draws without."""
    backend = str(settings.backend)
    if backend == PROCESSOR:
        return BackendProbe(backend, checks=(check_rendering(None, "processor"),))
    try:
        with create_gl_context(settings) as gl:
            checks = (check_rendering(gl, "compute"),) if gl.version_code >= COMPUTE_VERSION else ()
            return BackendProbe(backend, "", gl.renderer, str(gl.context.info["GL_VERSION"]), gl.version_code, checks)
    except Pix2FaceError as error:
        return BackendProbe(backend, str(error).removesuffix(f"; {REMEDY}"))


def probe_backend_apart(settings: GLSettings) -> BackendProbe:
    """As ``probe_backend``, in a process of its own; if that dies, the backend has failed."""
    found, failure = _ask(asdict(settings))
    if found is None:
        return BackendProbe(str(settings.backend), failure)
    return BackendProbe(**{**found, "checks": tuple(RenderCheck(**check) for check in found["checks"])})


def devices_apart() -> tuple[tuple[EGLDevice, ...], str]:
    """The devices that EGL lists, asked for in a process of its own, and why there are none."""
    found, failure = _ask(None)
    if found is None:
        return (), failure
    devices = [EGLDevice(**{**device, "extensions": tuple(device["extensions"])}) for device in found["devices"]]
    return tuple(devices), str(found["error"])


def answer(question: str) -> str:
    """Answers the question of another process: settings to be probed, or null for the devices; all in JSON."""
    settings = json.loads(question)
    if settings is not None:
        return json.dumps(asdict(probe_backend(GLSettings(**settings))))
    try:
        return json.dumps({"devices": [asdict(device) for device in egl_devices()], "error": ""})
    except OSError as error:
        return json.dumps({"devices": [], "error": str(error)})


def _ask(question: Mapping[str, Any] | None) -> tuple[dict[str, Any] | None, str]:
    """The answer to a question, or None and why there is none."""
    paths = os.pathsep.join([str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])])
    inherited = {name: value for name, value in os.environ.items() if name not in OUR_VARIABLES}
    try:
        done = subprocess.run(  # noqa: S603 - this interpreter, this package
            [sys.executable, "-c", PROGRAM, json.dumps(question)],
            env={**inherited, "PYTHONPATH": paths},
            check=False,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=SECONDS_AT_MOST,
        )
    except subprocess.TimeoutExpired:
        return None, f"no answer in {SECONDS_AT_MOST} seconds"
    if done.returncode == 0:
        return json.loads(done.stdout), ""
    last = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
    if done.returncode < 0:
        return None, f"the driver ended its process ({signal.Signals(-done.returncode).name}): {last}"
    return None, f"the test process failed: {last}"


def check_rendering(gl: GLContext | None, rasteriser: Rasteriser) -> RenderCheck:
    """Draws some faces of the built-in model, and counts the pixels that differ from the oracle's."""
    model = builtin_model()
    table = sample_faces(model, N_FACES, SEED, SIZE_PX)
    mask_px = mask_differs_px = 0
    errors_mm, seconds = [np.zeros(0)], []
    try:
        renderer = Renderer(model, SIZE_PX, SIZE_PX, gl, rasteriser)
        for vertices, matrix in zip(model.vertices(table.identity, table.expression), table.cameras, strict=True):
            camera = Camera(matrix)
            expected = render_maps(model, vertices, camera, SIZE_PX, SIZE_PX)
            for _ in range(3):
                start = time.perf_counter()
                found = renderer.render(vertices, camera)
                seconds.append(time.perf_counter() - start)
            mask_px += int(expected["mask"].sum())
            mask_differs_px += int((found["mask"] != expected["mask"]).sum())
            errors_mm.append(_errors_mm(found, expected))
    except Pix2FaceError as error:
        return RenderCheck(rasteriser, str(error))
    errors = np.concatenate(errors_mm)
    worst = float(np.quantile(errors, 0.999)) if len(errors) else 0.0
    off = int((~(errors <= LIMIT_MM)).sum())  # also counts NaN
    return RenderCheck(rasteriser, "", mask_px, mask_differs_px, off, worst, 1000 * min(seconds))


def _errors_mm(found: Mapping[str, np.ndarray], expected: Mapping[str, np.ndarray]) -> np.ndarray:
    """The largest difference of PNCC, offset and depth at each pixel that is face to both, mm."""
    both = found["mask"] & expected["mask"]
    apart = [np.abs(found[name] - expected[name])[both] for name in ("pncc", "offset", "depth")]
    return np.column_stack(apart).max(axis=1)
