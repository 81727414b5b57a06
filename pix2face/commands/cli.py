"""The command ``pix2face``: its subcommands, each in a module of its own."""

import sys
from collections.abc import Callable, Sequence

from pix2face.command_line import run_commands
from pix2face.commands.export_cli import export
from pix2face.commands.fit_cli import fit
from pix2face.commands.landmarks_cli import landmarks
from pix2face.commands.predict_cli import predict
from pix2face.commands.track_cli import track
from pix2face.commands.view_cli import view


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``pix2face``."""
    commands: dict[str, Callable[..., int]] = {
        "predict": predict,
        "fit": fit,
        "track": track,
        "view": view,
        "export": export,
        "landmarks": landmarks,
    }
    return run_commands("pix2face", "Dense 3D faces from photographs.", commands, arguments)


if __name__ == "__main__":
    sys.exit(main())
