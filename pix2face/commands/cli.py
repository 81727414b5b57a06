"""The command ``pix2face``: its subcommands, whose modules are imported when they run."""

import sys
from collections.abc import Sequence

from pix2face.commands.pix2face_config import (
    ExportConfig,
    FitConfig,
    LandmarksCommand,
    PageConfig,
    PredictConfig,
    TrackConfig,
    ViewConfig,
)
from pix2face.programs import Command, run_commands

COMMANDS = {
    "predict": Command(PredictConfig, "pix2face.commands.predict_cli:predict"),
    "fit": Command(FitConfig, "pix2face.commands.fit_cli:fit"),
    "track": Command(TrackConfig, "pix2face.commands.track_cli:track"),
    "view": Command(ViewConfig, "pix2face.commands.view_cli:view"),
    "export": Command(ExportConfig, "pix2face.commands.export_cli:export"),
    "page": Command(PageConfig, "pix2face.commands.export_cli:page"),
    "landmarks": Command(
        LandmarksCommand,
        "pix2face.commands.landmarks_cli:landmarks",
        help="Choose the landmark vertices of a model from annotated frames, or show where they lie.",
    ),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``pix2face``."""
    return run_commands("pix2face", "Dense 3D faces from photographs.", COMMANDS, arguments)


if __name__ == "__main__":
    sys.exit(main())
