"""Chooses what draws maps: a GPU by OpenGL where there is one, otherwise the processor without OpenGL."""

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

# Files by which graphics cards are reached.
GPU_FILES = ("dev/dri/renderD*", "dev/nvidia[0-9]*")


def open_context(settings: GLSettings, *, draws_pictures: bool, root: Path = Path("/")) -> GLContext | None:
    """The OpenGL context that a job needs; None if the processor does everything.

    Args:
        settings: What to use; what is left open is taken from the environment.
        draws_pictures: Whether pictures are drawn as well as maps. They always need OpenGL.
        root: Where the machine's files are.

    Raises:
        UsageError: There is no such backend or device.
        GLUnavailableError: OpenGL is needed or was asked for, and no context could be made.
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
    """The rasteriser that a setting means.

    Args:
        rasteriser: The setting.
        version_code: 450 for OpenGL 4.5; 0 where there is none.
        is_software: Whether OpenGL draws on the processor.

    Raises:
        GLUnavailableError: Compute shaders were asked for, and there are none.
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
    """Whether the machine has the files by which a GPU is reached."""
    return any(next(root.glob(pattern), None) is not None for pattern in GPU_FILES)
