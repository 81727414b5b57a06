"""The checkpoint that commands take where none is named: the one that comes with the package."""

from pathlib import Path

PACKAGED = Path(__file__).parents[1] / "assets" / "checkpoint.safetensors"
