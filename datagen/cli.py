"""The command ``datagen``: its subcommands, whose modules are imported when they run."""

import sys
from collections.abc import Sequence

from datagen.datagen_config import (
    CardConfig,
    CoeffsCommand,
    DoctorConfig,
    EmptyConfig,
    ExportConfig,
    FitConfig,
    ModelCommand,
    PreviewConfig,
    RenderConfig,
    SampleConfig,
    ShowConfig,
    StatsConfig,
    VerifyConfig,
)
from pix2face.programs import Command, run_commands

COMMANDS = {
    "sample": Command(SampleConfig, "datagen.faces.sample_cli:sample"),
    "appearance": Command(ShowConfig, "datagen.faces.sample_cli:appearance"),
    "render": Command(RenderConfig, "datagen.jobs.render_cli:render"),
    "empty": Command(EmptyConfig, "datagen.appearance.backdrop.empty_pictures_cli:empty"),
    "verify": Command(VerifyConfig, "datagen.jobs.verify_cli:verify"),
    "preview": Command(PreviewConfig, "datagen.inspection.inspect_cli:preview"),
    "stats": Command(StatsConfig, "datagen.inspection.inspect_cli:stats"),
    "card": Command(CardConfig, "datagen.inspection.inspect_cli:card"),
    "export": Command(ExportConfig, "datagen.inspection.inspect_cli:export"),
    "doctor": Command(DoctorConfig, "datagen.doctor.doctor_cli:doctor"),
    "model": Command(
        ModelCommand,
        "datagen.models.model_cli:model",
        help="Import a published morphable model, describe a model, or show it.",
    ),
    "coeffs": Command(
        CoeffsCommand,
        "datagen.jobs.coeffs_cli:coeffs",
        help="Convert coefficient files into a table, describe a table, or convert it to another model.",
    ),
    "fit": Command(FitConfig, "datagen.jobs.coeffs_cli:fit"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``datagen``."""
    return run_commands(
        "datagen", "Render ground truth for dense 3D faces from coefficients of a morphable model.", COMMANDS, arguments
    )


if __name__ == "__main__":
    sys.exit(main())
