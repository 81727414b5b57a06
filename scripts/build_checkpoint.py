"""Makes the checkpoint that comes with the package: samples faces, renders them, trains, chooses landmarks, exports.

    python -m scripts.build_checkpoint --out FOLDER [--landmarks-from ANNOTATED]

Every step is a command of the project, printed as it runs; run it again after an interruption, and it goes on where it
was. On two cores it takes a day, and 12 GB of memory. The result is FOLDER/release; docs/checkpoint.md says how good it
is, and keeps the logs.
"""

import argparse
import shlex
import subprocess
import sys
from pathlib import Path

PROGRAMS = Path(sys.executable).parent
APPEARANCE = Path(__file__).parent / "checkpoint" / "appearance.toml"
SEED, FACES, PICTURE_PX = 200, 60_000, 160
CROP_SCALE = 1.5
# Most pictures are seen small first: at 64 px a step costs a quarter.
STAGES = (
    ("64px", ("--size-px", 64, "--batch-size", 48, "--samples", 480_000, "--learning-rate", 1.5e-3, "--warm-up", 20_000)),
    ("128px", ("--size-px", 128, "--samples", 340_000, "--learning-rate", 1e-3, "--warm-up", 5_000)),
)
