"""What a machine has that OpenGL needs: libraries, device files, vendor files, variables. Nothing is drawn."""

import ctypes
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import distributions
from pathlib import Path
from platform import python_version
from typing import Any, final

import h5py

from datagen.opengl.egl_devices import EGL_LIBRARY, EGLDevice
from datagen.opengl.osmesa_context import OSMESA_LIBRARIES

GL_LIBRARY, NVIDIA_LIBRARY, OSMESA = "libGL.so.1", "libEGL_nvidia.so.0", "libOSMesa"
VENDOR_FOLDERS = ("usr/share/glvnd/egl_vendor.d", "etc/glvnd/egl_vendor.d")
VENDOR_VARIABLE, VENDOR_FOLDER_VARIABLE = "__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS"
# Variables that change what OpenGL does have names that begin so.
VARIABLES = ("PIX2FACE_", "GLCONTEXT_", "LIBGL_", "GALLIUM_", "LP_", "MESA_", "NVIDIA_", "__EGL_")
PACKAGES = ("pix2face", "numpy", "numba", "moderngl", "glcontext", "h5py", "isal", "opencv-python-headless")


@final
@dataclass(frozen=True)
class DeviceFile:
    """A file by which a graphics card is reached, such as /dev/dri/renderD128."""

    path: str
    group: str  # name or number of the group that may use it
    is_open: bool  # whether this process may use it


@final
@dataclass(frozen=True)
class Surroundings:
    """What is installed."""

    complaints: Mapping[str, str]  # why each library cannot be loaded; empty where it can
    devices: tuple[EGLDevice, ...] = ()  # the devices that EGL lists
    devices_error: str = ""  # why EGL lists none
    render_nodes: tuple[DeviceFile, ...] = ()  # /dev/dri/renderD*
    nvidia_nodes: tuple[DeviceFile, ...] = ()  # /dev/nvidia0 and so on
    vendor_files: tuple[str, ...] = ()  # they tell EGL which drivers there are
    missing_vendor_files: tuple[str, ...] = ()  # files and folders that a variable names and that do not exist
    is_container: bool = False  # whether this looks like a container
    environment: Mapping[str, str] = field(default_factory=dict)  # variables that change what OpenGL does


def survey(
    devices: tuple[tuple[EGLDevice, ...], str],
    root: Path = Path("/"),
    environment: Mapping[str, str] = os.environ,
    load: Callable[[str], Any] = ctypes.CDLL,
) -> Surroundings:
    """Finds out what is installed, given the devices that EGL lists and why it lists none."""
    files, missing = _vendor_files(root, environment)
    return Surroundings(
        complaints={
            **{name: _complaint(load, [name]) for name in (EGL_LIBRARY, GL_LIBRARY, NVIDIA_LIBRARY)},
            OSMESA: _complaint(load, OSMESA_LIBRARIES),
        },
        devices=devices[0],
        devices_error=devices[1],
        render_nodes=_device_files(root / "dev" / "dri", "renderD*"),
        nvidia_nodes=_device_files(root / "dev", "nvidia[0-9]*"),
        vendor_files=files,
        missing_vendor_files=missing,
        is_container=_is_container(root, environment),
        environment={name: value for name, value in sorted(environment.items()) if name.startswith(VARIABLES)},
    )


def versions() -> dict[str, str]:
    """Versions of Python and of the packages and libraries that take part in drawing."""
    installed = {package.name: package.version for package in distributions()}
    found = {name: installed.get(name, "not installed") for name in PACKAGES}
    return {"python": python_version(), **found, "hdf5": h5py.version.hdf5_version}


def _complaint(load: Callable[[str], Any], names: Sequence[str]) -> str:
    complaints = []
    for name in names:
        try:
            load(name)
        except OSError as error:
            complaints.append(str(error))
        else:
            return ""
    return complaints[0]


def _device_files(folder: Path, pattern: str) -> tuple[DeviceFile, ...]:
    found = []
    for path in sorted(folder.glob(pattern)):
        try:
            group = path.group()
        except (KeyError, OSError):
            group = str(path.lstat().st_gid)
        found.append(DeviceFile(str(path), group, os.access(path, os.R_OK | os.W_OK)))
    return tuple(found)


def _vendor_files(root: Path, environment: Mapping[str, str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The vendor files in use, and what a variable names and does not exist."""
    if environment.get(VENDOR_VARIABLE):
        named = [Path(name) for name in environment[VENDOR_VARIABLE].split(":") if name]
        present = [path for path in named if path.is_file()]
        return tuple(map(str, present)), tuple(str(path) for path in named if path not in present)
    chosen = [Path(name) for name in environment.get(VENDOR_FOLDER_VARIABLE, "").split(":") if name]
    folders = chosen or [root / folder for folder in VENDOR_FOLDERS]
    files = tuple(str(path) for folder in folders for path in sorted(folder.glob("*.json")))
    return files, tuple(str(folder) for folder in chosen if not folder.is_dir())


def _is_container(root: Path, environment: Mapping[str, str]) -> bool:
    marks = (root / ".dockerenv", root / "run" / ".containerenv")
    if environment.get("container") or any(mark.exists() for mark in marks):
        return True
    try:
        groups = (root / "proc" / "1" / "cgroup").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return any(word in groups for word in ("docker", "kubepods", "containerd", "lxc", "podman"))
