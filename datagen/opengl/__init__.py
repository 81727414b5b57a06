"""OpenGL contexts and devices without a display."""

from typing import Literal

Rasteriser = Literal["auto", "processor", "compute"]
