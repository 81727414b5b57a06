"""Checkpoints, and networks that read pictures."""

from pathlib import Path

# The checkpoint that comes with the package, and that commands take where none is named.
PACKAGED = Path(__file__).parents[1] / "assets" / "checkpoint.safetensors"
# Where training leaves its checkpoints.
RUNS = Path("runs")
CHECKPOINT_NAME = "checkpoint.safetensors"
