"""The command ``datagen``: sample or fit faces, render triplets, verify and look at shards, import models."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from datagen.appearance.appearance_cli import appearance
from datagen.appearance.appearance_config import load_configuration
from datagen.appearance.backdrop.empty_pictures_cli import empty
from datagen.doctor.doctor_cli import doctor
from datagen.inspection.inspect_cli import card, preview, stats, verify
from datagen.jobs.coeffs_cli import coeffs, fit
from datagen.jobs.render_cli import render
from datagen.models.model_cli import model
from datagen.sampling.faces import sample_faces
from pix2face.command_line import check_output_file, counted, run_commands, say
from pix2face.face_files.coefficients import save_coefficients
from pix2face.models.morphable_model import BUILTIN_MODEL, open_model

console = Console(stderr=True)


@dataclass(frozen=True)
class SampleConfig:
    """Configuration of ``datagen sample``.

    Attributes:
        out: Table of coefficients to write (.h5).
        n: Number of faces.
        seed: Seed of identities, expressions, poses and cameras. 0 is an ordinary seed.
        size: Side of the pictures to be rendered, in pixels.
        appearance: Distribution of the faces: `default`, `hard`, `plain`, or a TOML file, of which this command uses
            only the table [geometry] (docs/explanation/sampling.md).
        model: `builtin`, or a model file made by `datagen model import`.
    """

    out: Path
    n: int = 400
    seed: int = 0
    size: int = 256
    appearance: str = "default"
    model: str = BUILTIN_MODEL


def sample(config: Annotated[SampleConfig, tyro.conf.arg(name="")]) -> int:
    """Draw plausible faces, poses and cameras, and write them as a table of coefficients."""
    check_output_file(config.out, (".h5",))
    geometry = load_configuration(config.appearance).geometry
    table = sample_faces(open_model(config.model), config.n, config.seed, config.size, geometry)
    save_coefficients(table, config.out)
    say(console, f"{counted(len(table), 'face')} of {table.model_name} -> {config.out}")
    say(console, f"next: datagen render --coeffs {config.out} --out shards/")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``datagen``."""
    commands: dict[str, Callable[..., int]] = {
        "sample": sample,
        "appearance": appearance,
        "render": render,
        "empty": empty,
        "verify": verify,
        "preview": preview,
        "stats": stats,
        "card": card,
        "doctor": doctor,
        "model": model,
        "coeffs": coeffs,
        "fit": fit,
    }
    return run_commands(
        "datagen", "Render ground truth for dense 3D faces from coefficients of a morphable model.", commands, arguments
    )


if __name__ == "__main__":
    sys.exit(main())
