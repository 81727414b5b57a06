"""OpenGL without a display: contexts, devices, and what to do where it fails."""

from typing import Literal

Rasteriser = Literal["auto", "processor", "compute"]
