"""Where training leaves its checkpoints."""

from pathlib import Path

CHECKPOINT_NAME = "checkpoint.safetensors"
RUNS = Path("runs")
