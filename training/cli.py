"""The program ``train``: its commands, whose modules are imported when they run."""

import sys
from collections.abc import Sequence

from pix2face.programs import Command, run_commands
from training.train_config import CorrectionConfig, DetectorConfig, ExportConfig, TrainConfig, defaults_of

DESCRIPTION = """Train the network on shards that `datagen render` wrote.

After an interruption, run the same command again. It continues from the last saved state, and the result is the same as
without the interruption. `torchrun --nproc-per-node N -m training.cli ...` trains with several processes."""


COMMANDS = {
    "": Command(TrainConfig, "training.train_cli:train_network", default=defaults_of),
    "correction": Command(CorrectionConfig, "training.task_cli:correction"),
    "detector": Command(DetectorConfig, "training.task_cli:detector"),
    "export": Command(ExportConfig, "training.release.release_cli:export"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs ``train``; returns the exit status."""
    return run_commands("train", DESCRIPTION, COMMANDS, argv)


if __name__ == "__main__":
    sys.exit(main())
