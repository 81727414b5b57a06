"""An OpenGL context of OSMesa, which draws to memory and needs no EGL. moderngl has no backend for it."""

import ctypes
from collections.abc import Sequence
from typing import Any, final

OSMESA_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
# The newest first, since OSMesa returns exactly the version that is requested.
VERSIONS = ((4, 5), (4, 3), (3, 3))

# From GL/osmesa.h and GL/gl.h.
_OSMESA_FORMAT, _OSMESA_DEPTH_BITS, _OSMESA_PROFILE, _OSMESA_CORE_PROFILE = 0x22, 0x30, 0x33, 0x34
_OSMESA_MAJOR, _OSMESA_MINOR, _GL_RGBA, _GL_UNSIGNED_BYTE = 0x36, 0x37, 0x1908, 0x1401


def load_osmesa(names: Sequence[str] = OSMESA_LIBRARIES) -> ctypes.CDLL:
    """Loads the first library that exists.

    Raises:
        OSError: No library can be loaded. The message is that of the first.
    """
    messages = []
    for name in names:
        try:
            return ctypes.CDLL(name)
        except OSError as error:
            messages.append(str(error))
    raise OSError(messages[0])


@final
class OSMesaContext:
    """A context with the methods that moderngl calls: ``load``, ``__enter__``, ``__exit__`` and ``release``.

    Raises:
        OSError: The library cannot make a core profile of OpenGL 3.3 or newer.
    """

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
        self._handle = self._create()
        self._window = (ctypes.c_ubyte * 4)()  # a single pixel, since moderngl draws to other framebuffers
        self.__enter__()

    def _create(self) -> int:
        for major, minor in VERSIONS:
            attributes = [_OSMESA_FORMAT, _GL_RGBA, _OSMESA_DEPTH_BITS, 24, _OSMESA_PROFILE, _OSMESA_CORE_PROFILE]
            attributes += [_OSMESA_MAJOR, major, _OSMESA_MINOR, minor, 0]
            handle = self._library.OSMesaCreateContextAttribs((ctypes.c_int * len(attributes))(*attributes), None)
            if handle:
                return int(handle)
        raise OSError("OSMesaCreateContextAttribs made no core profile of OpenGL 3.3 or newer")

    def load(self, name: str) -> int:
        """Returns the address of an OpenGL function; 0 if it does not exist."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    def __enter__(self) -> "OSMesaContext":
        if not self._library.OSMesaMakeCurrent(self._handle, self._window, _GL_UNSIGNED_BYTE, 1, 1):
            raise OSError("OSMesaMakeCurrent refused its context")
        return self

    def __exit__(self, *_: Any) -> None:
        pass

    def release(self) -> None:
        """Destroys the context. Afterwards, no context is current."""
        if self._handle:
            self._library.OSMesaMakeCurrent(None, None, _GL_UNSIGNED_BYTE, 0, 0)
            self._library.OSMesaDestroyContext(self._handle)
            self._handle = 0
