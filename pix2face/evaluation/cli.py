"""The command ``evaluate``, and ``evaluate compare``; their modules are imported when they run."""

import sys
from collections.abc import Sequence

from pix2face.evaluation.evaluate_config import CompareConfig, EvaluateConfig
from pix2face.programs import Command, run_commands

DESCRIPTION = (
    "Measure a checkpoint, or the landmarks of another system, on a benchmark: tables with intervals, report.json and "
    "a page."
)
COMMANDS = {
    "": Command(EvaluateConfig, "pix2face.evaluation.evaluate_cli:evaluate"),
    "compare": Command(CompareConfig, "pix2face.evaluation.report.compare_cli:compare"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``evaluate``."""
    return run_commands("evaluate", DESCRIPTION, COMMANDS, arguments)


if __name__ == "__main__":
    sys.exit(main())
