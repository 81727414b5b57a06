"""An OpenGL context without a window: EGL first, OSMesa second, a clear error third."""

import ctypes
import os
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, final

import moderngl

from pix2face.errors import GLUnavailableError, UsageError

BACKENDS = ("egl", "osmesa")
ENVIRONMENT_VARIABLE = "PIX2FACE_GL"
OSMESA_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
REMEDY = (
    "install Mesa (Debian, Ubuntu: apt-get install libegl1 libgl1 libgl1-mesa-dri for EGL, libosmesa6 for OSMesa), "
    f"or choose another backend with {ENVIRONMENT_VARIABLE}=egl or {ENVIRONMENT_VARIABLE}=osmesa"
)

# From GL/osmesa.h and GL/gl.h.
_OSMESA_FORMAT, _OSMESA_DEPTH_BITS, _OSMESA_PROFILE, _OSMESA_CORE_PROFILE = 0x22, 0x30, 0x33, 0x34
_OSMESA_MAJOR, _OSMESA_MINOR, _GL_RGBA, _GL_UNSIGNED_BYTE = 0x36, 0x37, 0x1908, 0x1401


@final
@dataclass(frozen=True, eq=False)
class GLContext:
    """An OpenGL 3.3 context and where it comes from.

    Attributes:
        context: What draws.
        backend: ``egl`` or ``osmesa``.
        renderer: What the driver calls itself.
    """

    context: moderngl.Context
    backend: str
    renderer: str

    def release(self) -> None:
        """Gives the context back; nothing made from it can be used afterwards."""
        self.context.release()

    def __enter__(self) -> "GLContext":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def create_gl_context(backend: str | None = None) -> GLContext:
    """Makes an OpenGL context that needs no display.

    Args:
        backend: ``egl`` or ``osmesa``; None takes the environment variable PIX2FACE_GL, and without it tries EGL, then
            OSMesa. Both bring Mesa's dispatch tables: use one of them in a process.

    Raises:
        UsageError: There is no backend of that name.
        GLUnavailableError: None could be made; the message says what each backend complained about.
    """
    forced = backend or os.environ.get(ENVIRONMENT_VARIABLE)
    if forced and forced not in BACKENDS:
        source = "backend" if backend else ENVIRONMENT_VARIABLE
        raise UsageError(f"{source}: expected one of {', '.join(BACKENDS)}, found {forced!r}")
    failures = []
    for name in [forced] if forced else BACKENDS:
        try:
            context = _CREATORS[name]()
        except Exception as error:  # noqa: BLE001 - glcontext raises bare Exception
            failures.append(f"{name}: {str(error).strip() or type(error).__name__}")
            continue
        return GLContext(context, name, str(context.info["GL_RENDERER"]))
    raise GLUnavailableError(f"expected OpenGL 3.3 without a display, found none ({'; '.join(failures)}); {REMEDY}")


def _create_egl() -> moderngl.Context:
    settings: dict[str, Any] = {"backend": "egl"}
    return moderngl.create_context(standalone=True, **settings)


def _create_osmesa() -> moderngl.Context:
    context = _OSMesaContext(_load_osmesa())
    settings: dict[str, Any] = {"context": context}
    try:
        return moderngl.create_context(standalone=True, **settings)
    except BaseException:
        context.release()
        raise


_CREATORS: dict[str, Callable[[], moderngl.Context]] = {"egl": _create_egl, "osmesa": _create_osmesa}


def _load_osmesa() -> ctypes.CDLL:
    complaints = []
    for name in OSMESA_LIBRARIES:
        try:
            return ctypes.CDLL(name)
        except OSError as error:
            complaints.append(str(error))
    raise OSError(complaints[0])


@final
class _OSMesaContext:
    """The protocol by which moderngl takes a context of somebody else's: load, enter, exit, release."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library
        library.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        library.OSMesaCreateContextAttribs.argtypes = [ctypes.POINTER(ctypes.c_int), ctypes.c_void_p]
        library.OSMesaMakeCurrent.restype = ctypes.c_ubyte
        library.OSMesaMakeCurrent.argtypes = [ctypes.c_void_p, ctypes.c_void_p, *([ctypes.c_int] * 3)]
        library.OSMesaGetProcAddress.restype = ctypes.c_void_p
        library.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        library.OSMesaDestroyContext.restype = None
        library.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        attributes = [_OSMESA_FORMAT, _GL_RGBA, _OSMESA_DEPTH_BITS, 24, _OSMESA_PROFILE, _OSMESA_CORE_PROFILE]
        attributes += [_OSMESA_MAJOR, 3, _OSMESA_MINOR, 3, 0]
        self._handle = library.OSMesaCreateContextAttribs((ctypes.c_int * len(attributes))(*attributes), None)
        if not self._handle:
            raise OSError("OSMesaCreateContextAttribs made no core profile of OpenGL 3.3")
        self._window = (ctypes.c_ubyte * 4)()  # one pixel: drawing goes to framebuffers of its own
        self.__enter__()

    def load(self, name: str) -> int:
        """Address of an OpenGL function, 0 where there is none."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    load_opengl_function = load  # its name before moderngl 5.12

    def __enter__(self) -> "_OSMesaContext":
        if not self._library.OSMesaMakeCurrent(self._handle, self._window, _GL_UNSIGNED_BYTE, 1, 1):
            raise OSError("OSMesaMakeCurrent refused its context")
        return self

    def __exit__(self, *_: Any) -> None:
        pass

    def release(self) -> None:
        """Destroys the context."""
        if self._handle:
            self._library.OSMesaDestroyContext(self._handle)
            self._handle = None
