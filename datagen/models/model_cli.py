"""The command ``datagen model``, which imports, describes or draws a morphable model."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float32
from numpy import ndarray
from rich.console import Console
from rich.table import Table
from rich.text import Text

from datagen.datagen_config import ModelCommand, ModelImportConfig, ModelInfoConfig, ModelViewConfig
from datagen.models.model_view import MESH_SUFFIXES, PICTURE_SUFFIXES, write_view
from pix2face.command_line import check_output_file, printable, say
from pix2face.errors import UsageError
from pix2face.geometry.landmarks import IBUG68
from pix2face.model_formats.model_import import import_model
from pix2face.models import BUILTIN_MODEL
from pix2face.models.model_crop import without_regions
from pix2face.models.model_file import Alignment, read_stored_model, write_stored_model
from pix2face.models.morphable_model import MorphableModel, load_model, open_model

SHOWN_COMPONENTS = 5

console = Console(stderr=True)


def model(command: ModelCommand) -> int:
    """Runs ``datagen model``."""
    if isinstance(command, ModelImportConfig):
        return _import_model(command)
    return _show_model(command) if isinstance(command, ModelInfoConfig) else _view_model(command)


def describe(model: MorphableModel) -> str:
    """Describes a model in one line."""
    components = f"{model.n_identity} identity and {model.n_expression} expression components"
    return f"{model.name} ({len(model.mean)} vertices, {components}, {model.sha256[:12]})"


def _import_model(config: ModelImportConfig) -> int:
    check_output_file(config.out, (".h5",))
    imported = import_model(config.path)
    stored = imported.model
    if config.without:
        stored = replace(
            without_regions(stored, *config.without), name=f"{stored.name} without {', '.join(config.without)}"
        )
    write_stored_model(stored, config.out)
    for note in imported.notes:
        say(console, note)
    say(console, f"{describe(load_model(config.out))} -> {config.out}")
    say(console, f"terms: {stored.licence}")
    say(console, f"next: datagen model view {config.out} --out sheet.jpg")
    return 0


def _view_model(config: ModelViewConfig) -> int:
    if config.components < 1:
        raise UsageError(f"expected at least one component to show (--components), found {config.components}")
    check_output_file(config.out, PICTURE_SUFFIXES + MESH_SUFFIXES)
    write_view(open_model(config.model), config.out, config.components)
    say(console, f"{config.model} -> {config.out}")
    return 0


def _show_model(config: ModelInfoConfig) -> int:
    shown = open_model(config.model)
    alignment = None if config.model == BUILTIN_MODEL else read_stored_model(Path(config.model))[0].alignment
    table = Table(show_header=False, title=Text(printable(shown.name)))
    table.add_column(overflow="fold")
    table.add_column(overflow="fold")
    for name, value in _rows(shown, alignment):
        table.add_row(name, Text(printable(value)))
    Console().print(table)
    return 0


def _rows(shown: MorphableModel, alignment: Alignment | None) -> Iterator[tuple[str, str]]:
    extents = zip("xyz", shown.mean.min(axis=0), shown.mean.max(axis=0), strict=True)
    yield "vertices, triangles", f"{len(shown.mean)}, {len(shown.triangles)}"
    yield "extent of the mean", ", ".join(f"{axis} {low:.1f} .. {high:.1f} mm" for axis, low, high in extents)
    yield "nearest face point to the origin", f"{shown.smallest_radius_mm:.1f} mm"
    yield "identity", _variance(shown.identity_basis)
    yield "expression", _variance(shown.expression_basis)
    yield "named expressions", str(len(shown.named_expressions))
    if shown.albedo_basis is not None:
        yield "albedo", f"{len(shown.albedo_basis)} components"
    yield "regions (face first)", _regions(shown)
    yield "landmarks", _landmarks(shown)
    if alignment is not None:
        yield "landmarks or surface to the built-in model", f"{alignment.residual_mm:.1f} mm (RMS)"
        yield "scale that a similarity would have applied", f"{alignment.landmark_scale:.3f}"
    yield "texture coordinates", "yes" if shown.uv is not None else "no"
    yield "mirror symmetry", "yes" if shown.symmetry is not None else "no"
    yield "basis of coefficient files", shown.published_basis or "its own"
    yield "licence", shown.licence
    yield "origin", shown.origin
    yield "sha256", shown.sha256


def _variance(basis: Float32[ndarray, "k v 3"]) -> str:
    """Describes how far the components move vertices, and the shares of the first ones in the variance."""
    if not len(basis):
        return "none"
    powers = np.array([float((component.astype(np.float64) ** 2).sum()) for component in basis])
    rms = float(np.sqrt(powers.sum() / basis.shape[1]))
    shares = ", ".join(f"{100 * power / max(powers.sum(), 1e-30):.1f} %" for power in powers[:SHOWN_COMPONENTS])
    return f"{len(basis)} components; a vertex moves {rms:.1f} mm (RMS); first shares of the variance: {shares}"


def _regions(shown: MorphableModel) -> str:
    others = [name for name in shown.region_names if name not in shown.face_regions]
    return ", ".join(shown.face_regions) + (f"; {', '.join(others)}" if others else "")


def _landmarks(shown: MorphableModel) -> str:
    if not shown.landmarks:
        return "none: what needs landmarks will refuse this model"
    text = ", ".join(f"{scheme} ({len(indices)})" for scheme, indices in shown.landmarks.items())
    approximate = shown.approximate_landmarks
    if approximate is None or not len(approximate) or IBUG68 not in shown.landmarks:
        return text
    return f"{text}; {len(approximate)} of them approximate, by correspondence: {_runs(approximate)}"


def _runs(numbers: ndarray) -> str:
    """Formats sorted numbers as ranges, such as "1-3, 7"."""
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1)
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)
