"""The command ``datagen model``: import a published morphable model, or describe one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pix2face.command_line import printable, say
from pix2face.model_file import write_stored_model
from pix2face.model_formats.bfm2009 import read_bfm2009
from pix2face.morphable_model import BUILTIN_MODEL, MorphableModel, load_model, open_model

console = Console(stderr=True)


@dataclass(frozen=True)
class ModelImportConfig:
    """Bring a published model into the project's own file (BFM 2009 as 300W-LP uses it)."""

    path: Annotated[Path, tyro.conf.Positional]
    """Folder with Model_Shape.mat and Model_Expression.mat (BFM 2009 as 300W-LP uses it)."""
    out: Path
    """Model file to write (.h5)."""


@dataclass(frozen=True)
class ModelInfoConfig:
    """Print sizes, extents, components, licence and hash of a model."""

    model: Annotated[str, tyro.conf.Positional] = BUILTIN_MODEL
    """``builtin``, or a model file."""


def model(
    command: Annotated[
        Annotated[ModelImportConfig, tyro.conf.subcommand("import", prefix_name=False)]
        | Annotated[ModelInfoConfig, tyro.conf.subcommand("info", prefix_name=False)],
        tyro.conf.arg(name=""),
    ],
) -> int:
    """Import a published morphable model, or describe one."""
    return _import_model(command) if isinstance(command, ModelImportConfig) else _show_model(command)


def describe(model: MorphableModel) -> str:
    """A model in one line."""
    components = f"{model.n_identity} identity and {model.n_expression} expression components"
    return f"{model.name} ({len(model.mean)} vertices, {components}, {model.sha256[:12]})"


def _import_model(config: ModelImportConfig) -> int:
    write_stored_model(read_bfm2009(config.path), config.out)
    say(console, f"{describe(load_model(config.out))} -> {config.out}")
    return 0


def _show_model(config: ModelInfoConfig) -> int:
    shown = open_model(config.model)
    table = Table(show_header=False, title=Text(printable(shown.name)))
    extents = zip("xyz", shown.mean.min(axis=0), shown.mean.max(axis=0), strict=True)
    for name, value in {
        "vertices, triangles": f"{len(shown.mean)}, {len(shown.triangles)}",
        "extent of the mean": ", ".join(f"{axis} {low:.1f} .. {high:.1f} mm" for axis, low, high in extents),
        "nearest face point to the origin": f"{shown.smallest_radius_mm:.1f} mm",
        "components": f"{shown.n_identity} identity, {shown.n_expression} expression",
        "named expressions": str(len(shown.named_expressions)),
        "face regions": ", ".join(shown.face_regions),
        "landmarks": ", ".join(f"{scheme} ({len(indices)})" for scheme, indices in shown.landmarks.items()),
        "mirror symmetry": "yes" if shown.symmetry is not None else "no",
        "licence": shown.licence,
        "origin": shown.origin,
        "sha256": shown.sha256,
    }.items():
        table.add_row(name, Text(printable(value)))
    Console().print(table)
    return 0
