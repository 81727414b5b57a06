"""Lists the devices of EGL with ctypes, without making a context."""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

EGL_LIBRARY = "libEGL.so.1"

# From EGL/egl.h and EGL/eglext.h.
_EGL_EXTENSIONS, _EGL_VENDOR, _EGL_VERSION = 0x3055, 0x3053, 0x3054
_EGL_DRM_DEVICE_FILE, _EGL_DRM_RENDER_NODE_FILE, _EGL_PLATFORM_DEVICE = 0x3233, 0x3377, 0x313F
_POINTER = ctypes.c_void_p


@final
@dataclass(frozen=True)
class EGLDevice:
    """A device in EGL's list."""

    index: int  # number for `--device`
    vendor: str  # vendor, name (if known) and version of the driver; empty if the driver does not start
    extensions: tuple[str, ...]  # EGL extensions of the device, such as EGL_MESA_device_software
    render_node: str | None  # device file, such as /dev/dri/renderD128

    @property
    def is_software(self) -> bool:
        """Whether it draws on the processor."""
        return "EGL_MESA_device_software" in self.extensions

    @property
    def description(self) -> str:
        """A description for messages."""
        name = self.vendor or "a driver that does not start"
        if "EGL_NV_device_cuda" in self.extensions:
            name += ", CUDA"
        return f"{name}, software" if self.is_software else f"{name}, {self.render_node or 'no render node'}"


def egl_devices(library: str = EGL_LIBRARY) -> list[EGLDevice]:
    """Lists the devices in the order of ``--device``. This starts the driver of each, to get its name.

    Raises:
        OSError: The library does not exist, or cannot list devices.
    """
    egl = _load(library)
    return [_describe(egl, index, handle) for index, handle in enumerate(_handles(egl, library))]


def count_egl_devices(library: str = EGL_LIBRARY) -> int:
    """Counts the devices without starting their drivers.

    Raises:
        OSError: As ``egl_devices``.
    """
    return len(_handles(_load(library), library))


def _load(library: str) -> ctypes.CDLL:
    egl = ctypes.CDLL(library)
    if not hasattr(egl, "eglGetProcAddress"):
        raise OSError(f"{library} is no EGL: it has no eglGetProcAddress")
    return egl


def _handles(egl: ctypes.CDLL, library: str) -> list[int | None]:
    query_devices = _function(egl, "eglQueryDevicesEXT", ctypes.c_uint, [ctypes.c_int, _POINTER, _POINTER])
    count = ctypes.c_int()
    if not query_devices(0, None, ctypes.byref(count)):
        raise OSError(f"{library}: eglQueryDevicesEXT failed")
    handles = (ctypes.c_void_p * count.value)()
    if count.value and not query_devices(count.value, handles, ctypes.byref(count)):
        raise OSError(f"{library}: eglQueryDevicesEXT failed")
    return list(handles[: count.value])


def _describe(egl: ctypes.CDLL, index: int, handle: int | None) -> EGLDevice:
    query = _function(egl, "eglQueryDeviceStringEXT", ctypes.c_char_p, [_POINTER, ctypes.c_int])
    extensions = tuple((query(handle, _EGL_EXTENSIONS) or b"").decode(errors="replace").split())
    node = query(handle, _EGL_DRM_RENDER_NODE_FILE) if "EGL_EXT_device_drm_render_node" in extensions else None
    node = node or (query(handle, _EGL_DRM_DEVICE_FILE) if "EGL_EXT_device_drm" in extensions else None)
    return EGLDevice(index, _vendor(egl, handle), extensions, node.decode(errors="replace") if node else None)


def _vendor(egl: ctypes.CDLL, handle: int | None) -> str:
    """Returns vendor, driver and version. The display stays initialised, since another context may use it."""
    get_display = _function(egl, "eglGetPlatformDisplayEXT", _POINTER, [ctypes.c_uint, _POINTER, _POINTER])
    display = get_display(_EGL_PLATFORM_DEVICE, handle, None)
    initialise = _function(egl, "eglInitialize", ctypes.c_uint, [_POINTER, _POINTER, _POINTER])
    if not display or not initialise(display, None, None):
        return ""
    query = _function(egl, "eglQueryString", ctypes.c_char_p, [_POINTER, ctypes.c_int])
    asked = (_EGL_VENDOR, _EGL_VERSION, _EGL_EXTENSIONS)
    vendor, version, extensions = ((query(display, name) or b"").decode(errors="replace") for name in asked)
    if "EGL_MESA_query_driver" in extensions.split():
        name = _function(egl, "eglGetDisplayDriverName", ctypes.c_char_p, [_POINTER])(display) or b""
        vendor = f"{vendor}, driver {name.decode(errors='replace')}"
    return f"{vendor} (EGL {version})"


def _function(egl: ctypes.CDLL, name: str, result: Any, arguments: list[Any]) -> Callable[..., Any]:
    """Finds a function of EGL or of one of its extensions."""
    find = egl.eglGetProcAddress
    find.restype, find.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    address = find(name.encode())
    if not address:
        raise OSError(f"{EGL_LIBRARY} has no {name}: it is too old to list its devices")
    return ctypes.CFUNCTYPE(result, *arguments)(address)
