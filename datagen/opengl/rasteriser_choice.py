"""Chooses the rasteriser of maps: OpenGL on a GPU if there is one, otherwise the processor without OpenGL."""

from pathlib import Path
from typing import Literal

from datagen.opengl import Rasteriser
from datagen.opengl.gl_context import (
    COMPUTE_VERSION,
    RASTERISER_VARIABLE,
    GLContext,
    GLSettings,
    create_gl_context,
)
from pix2face.errors import GLUnavailableError

# Device files of GPUs.
GPU_FILES = ("dev/dri/renderD*", "dev/nvidia[0-9]*")


def open_context(settings: GLSettings, *, draws_pictures: bool, root: Path = Path("/")) -> GLContext | None:
    """Opens the OpenGL context that a job needs; None if the processor draws everything.

    Args:
        settings: Settings. What they leave open is read from the environment.
        draws_pictures: Whether pictures are drawn, which need OpenGL, or only maps.
        root: Root of the file system, in which GPUs are searched.

    Raises:
        UsageError: There is no such backend or device.
        GLUnavailableError: OpenGL is needed or requested, and no context could be made.
    """
    chosen = settings.resolved()
    if draws_pictures or chosen.rasteriser == "compute":
        return create_gl_context(chosen)
    if chosen.rasteriser == "processor":
        return None
    if chosen.backend is not None or chosen.device is not None:
        return create_gl_context(chosen)
    if not has_gpu_files(root):
        return None
    try:
        return create_gl_context(chosen)
    except GLUnavailableError:
        return None


def choose_rasteriser(
    rasteriser: Rasteriser, version_code: int, *, is_software: bool
) -> Literal["processor", "compute"]:
    """Returns the rasteriser to use for a setting.

    Args:
        rasteriser: The setting.
        version_code: Version of OpenGL, such as 450 for 4.5; 0 without OpenGL.
        is_software: Whether OpenGL draws on the processor.

    Raises:
        GLUnavailableError: The setting is `compute`, and OpenGL has no compute shaders.
    """
    has_compute = version_code >= COMPUTE_VERSION
    if rasteriser == "processor" or (rasteriser == "auto" and (is_software or not has_compute)):
        return "processor"
    if not has_compute:
        found = f"{version_code // 100}.{version_code // 10 % 10}" if version_code else "none"
        raise GLUnavailableError(
            f"expected OpenGL 4.3 for the rasteriser compute, found {found}; "
            f"choose the rasteriser processor ({RASTERISER_VARIABLE}=processor), or auto"
        )
    return "compute"


def has_gpu_files(root: Path = Path("/")) -> bool:
    """Whether the machine has the device files of a GPU."""
    return any(next(root.glob(pattern), None) is not None for pattern in GPU_FILES)
