"""Makes an OpenGL context without a window, with EGL or OSMesa."""

import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, final, get_args

import moderngl

from datagen.opengl import Rasteriser
from datagen.opengl.egl_devices import count_egl_devices, egl_devices
from datagen.opengl.osmesa_context import OSMesaContext, load_osmesa
from pix2face.errors import GLUnavailableError, UsageError

BACKENDS = ("egl", "osmesa")
RASTERISERS: tuple[Rasteriser, ...] = get_args(Rasteriser)
ENVIRONMENT_VARIABLE = "PIX2FACE_GL"
DEVICE_VARIABLE = "PIX2FACE_GL_DEVICE"
RASTERISER_VARIABLE = "PIX2FACE_RASTERISER"
# The variable of moderngl, which would silently override DEVICE_VARIABLE.
FOREIGN_DEVICE_VARIABLE = "GLCONTEXT_DEVICE_INDEX"
# OpenGL 4.3 introduced compute shaders and shader storage buffers.
COMPUTE_VERSION, OLDEST_VERSION = 430, 330
SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast")
REMEDY = (
    "install Mesa (Debian, Ubuntu: apt-get install libegl1 libgl1 libgl1-mesa-dri for EGL, libosmesa6 for OSMesa), "
    f"or choose another backend with {ENVIRONMENT_VARIABLE}=egl or {ENVIRONMENT_VARIABLE}=osmesa; "
    "`datagen doctor` says more"
)


@final
@dataclass(frozen=True)
class GLSettings:
    """Backend, device and rasteriser. The values can be sent to worker processes."""

    backend: str | None = None  # None tries `egl`, then `osmesa`
    device: int | None = None  # number in EGL's list, from 0 (`datagen doctor` shows it); None uses the first
    rasteriser: Rasteriser = "auto"  # `auto`: `compute` on a GPU that has OpenGL 4.3, otherwise `processor`

    @property
    def allowed_backends(self) -> tuple[str, ...]:
        """The backends that may be used, in the order in which they are tried."""
        if self.backend is not None:
            return (self.backend,)
        return BACKENDS if self.device is None else ("egl",)

    def resolved(self, environment: Mapping[str, str] = os.environ) -> "GLSettings":
        """Completes these settings from PIX2FACE_GL, PIX2FACE_GL_DEVICE and PIX2FACE_RASTERISER.

        Raises:
            UsageError: A value is unknown, or two values exclude each other.
        """
        settings = self
        if settings.backend is None and environment.get(ENVIRONMENT_VARIABLE):
            settings = replace(settings, backend=_known(ENVIRONMENT_VARIABLE, environment, BACKENDS))
        if settings.device is None and environment.get(DEVICE_VARIABLE):
            settings = replace(settings, device=_device_number(environment[DEVICE_VARIABLE]))
        if settings.rasteriser == "auto" and environment.get(RASTERISER_VARIABLE):
            settings = replace(settings, rasteriser=_known(RASTERISER_VARIABLE, environment, RASTERISERS))
        settings._check(environment)
        return settings

    def _check(self, environment: Mapping[str, str]) -> None:
        if self.backend is not None:
            _known("backend", {"backend": self.backend}, BACKENDS)
        _known("rasteriser", {"rasteriser": self.rasteriser}, RASTERISERS)
        if self.device is None:
            return
        if self.device < 0:
            raise UsageError(f"device: expected the number of a device, from 0, found {self.device}")
        if self.backend == "osmesa":
            raise UsageError(
                f"expected no device with the backend osmesa, which draws on the processor, found {self.device}; "
                f"leave out the device ({DEVICE_VARIABLE}) or choose egl"
            )
        foreign = environment.get(FOREIGN_DEVICE_VARIABLE, str(self.device))
        if foreign != str(self.device):
            raise UsageError(
                f"expected one choice of device, found {self.device} and {FOREIGN_DEVICE_VARIABLE}={foreign}; unset it"
            )


@final
@dataclass(frozen=True, eq=False)
class GLContext:
    """An OpenGL context and its origin. It belongs to the thread that made it."""

    context: moderngl.Context
    backend: str  # `egl` or `osmesa`
    renderer: str  # name of the renderer, from the driver
    version_code: int = OLDEST_VERSION  # 450 for OpenGL 4.5; at least 330
    rasteriser: Rasteriser = "auto"  # the requested rasteriser; `choose_rasteriser` turns `auto` into one of the others
    device: int | None = None  # number of the requested EGL device

    @property
    def is_software(self) -> bool:
        """Whether it draws on the processor."""
        return is_software_renderer(self.renderer)

    def make_current(self) -> None:
        """Makes this the context of OpenGL calls in this thread, and frees its unreferenced objects."""
        self.context.mglo.__enter__()
        self.context.gc()

    def check(self) -> None:
        """Raises GLUnavailableError if the error flag of OpenGL is set."""
        error = self.context.error
        if error != "GL_NO_ERROR":
            raise GLUnavailableError(f"expected {self.renderer} to draw, found {error}; is its memory full?")

    def release(self) -> None:
        """Destroys the context and all objects made from it.

        The newest other context of this thread becomes current, so that its user can go on.
        """
        others = [other for other in _living() if other is not self]
        if not isinstance(self.context.mglo, moderngl.InvalidObject):
            self.make_current()  # objects must be freed in their own context
            self.context.release()
            _THREAD.living = others
        if others:
            others[-1].make_current()

    def __enter__(self) -> "GLContext":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def create_gl_context(settings: GLSettings | str | None = None) -> GLContext:
    """Makes an OpenGL context that needs no display, of the newest version that the driver has.

    Both backends load Mesa's dispatch tables, so use only one of them in a process.

    Args:
        settings: Settings, or the name of a backend. What they leave open is read from the environment.

    Raises:
        UsageError: There is no such backend or device.
        GLUnavailableError: No context could be made. The message includes the error of each backend.
    """
    chosen = (settings if isinstance(settings, GLSettings) else GLSettings(settings)).resolved()
    failures = []
    for name in chosen.allowed_backends:
        try:
            context = _CREATORS[name](chosen)
        except UsageError:
            raise
        except Exception as error:  # noqa: BLE001 - glcontext raises bare Exception
            failures.append(f"{name}: {str(error).strip() or type(error).__name__}")
            continue
        context.gc_mode = "context_gc"  # only make_current frees objects, since then no other context is current
        renderer, version = str(context.info["GL_RENDERER"]), int(context.version_code)
        made = GLContext(context, name, renderer, version, chosen.rasteriser, chosen.device)
        _THREAD.living = [*_living(), made]
        return made
    raise GLUnavailableError(f"expected OpenGL 3.3 without a display, found none ({'; '.join(failures)}); {REMEDY}")


def is_software_renderer(name: str) -> bool:
    """Whether a driver of this name draws on the processor."""
    return any(known in name.lower() for known in SOFTWARE_RENDERERS)


def _create_egl(settings: GLSettings) -> moderngl.Context:
    if settings.device is not None:
        _check_device(settings.device)
    # With library names, since moderngl would search for them with programs that small containers lack.
    arguments: dict[str, Any] = {"backend": "egl", "libegl": "libEGL.so.1", "libgl": "libGL.so.1"}
    if settings.device is not None:
        arguments["device_index"] = settings.device
    try:
        return moderngl.create_context(require=COMPUTE_VERSION, standalone=True, **arguments)
    except Exception:  # noqa: BLE001 - glcontext raises bare Exception, and the next call would raise the same
        return moderngl.create_context(require=OLDEST_VERSION, standalone=True, **arguments)


def _create_osmesa(settings: GLSettings) -> moderngl.Context:
    context = OSMesaContext(load_osmesa())
    arguments: dict[str, Any] = {"context": context}
    try:
        return moderngl.create_context(standalone=True, **arguments)
    except BaseException:
        context.release()
        raise


_CREATORS: dict[str, Callable[[GLSettings], moderngl.Context]] = {"egl": _create_egl, "osmesa": _create_osmesa}
# The contexts of each thread, the newest last.
_THREAD = threading.local()


def _living() -> list[GLContext]:
    return getattr(_THREAD, "living", [])


def _check_device(number: int) -> None:
    n_devices = count_egl_devices()
    if number >= n_devices:
        listed = "; ".join(f"{device.index}: {device.description}" for device in egl_devices()) or "none"
        raise UsageError(
            f"device: expected one of the {n_devices} that EGL lists ({listed}), found {number}; "
            "`datagen doctor` shows them"
        )


def _device_number(text: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise UsageError(f"{DEVICE_VARIABLE}: expected the number of a device, from 0, found {text!r}")
    return int(text)


def _known(name: str, values: Mapping[str, str], known: tuple[Any, ...]) -> Any:
    if values[name] not in known:
        raise UsageError(f"{name}: expected one of {', '.join(known)}, found {values[name]!r}")
    return values[name]
