"""The commands ``datagen coeffs`` and ``datagen fit``: tables of coefficients from folders, and between models."""

import os
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text

from datagen.faces.model_transfer import Through, transfer_table
from datagen.faces.sources import coefficient_paths
from datagen.inspection.coefficient_summary import CoefficientSummary, group_reasons, summarise_folder, summarise_table
from datagen.inspection.statistics_tables import print_statistics
from datagen.jobs.conversion import ConversionJob, ConversionSummary, convert, open_job, rejected_path
from datagen.process_pool import process_pool
from pix2face.command_line import (
    EXIT_REJECTED,
    check_max_rejected,
    check_output_file,
    counted,
    printable,
    progress_bar,
    say,
)
from pix2face.errors import UsageError
from pix2face.face_files.coefficients import load_coefficients, moved_path, save_coefficients
from pix2face.models.morphable_model import BUILTIN_MODEL, open_model

console = Console(stderr=True)
SHOWN_REASONS = 10


@dataclass(frozen=True, kw_only=True)
class _ConversionConfig:
    """What the commands that write tables of photographs share.

    Attributes:
        out: Table to write (.h5). Faces that cannot be used are listed in NAME.rejected.jsonl beside it.
        model: `builtin`, or a model file made by `datagen model import`.
        workers: Number of processes that read and fit.
        max_rejected: Largest number of rejected faces for which the exit status is still 0; with more, it is 3.
    """

    out: Path
    model: str = BUILTIN_MODEL
    workers: int = os.cpu_count() or 1
    max_rejected: int = 0


@dataclass(frozen=True, kw_only=True)
class CoeffsConvertConfig(_ConversionConfig):
    """Read a folder of 300W-LP or AFLW2000-3D files into one table.

    With an imported BFM 2009, the table contains the coefficients of the files (in standard deviations). Any other
    model is fitted to their landmarks.

    Attributes:
        source: Folder of .mat files with their pictures, including subfolders.
    """

    source: Annotated[Path, tyro.conf.arg(name="from")]


@dataclass(frozen=True, kw_only=True)
class FitConfig(_ConversionConfig):
    """Configuration of ``datagen fit``.

    Attributes:
        landmarks: Folder of photographs with 68 annotated points per face: .pts files as in 300-W, .mat files with
            pt3d_68, or .xml lists of dlib.
    """

    landmarks: Path


@dataclass(frozen=True)
class CoeffsInfoConfig:
    """Print the model, poses, coefficients and attributes of the faces, and say what is rare and what was rejected.

    Attributes:
        source: A table (.h5), or a folder of 300W-LP or AFLW2000-3D files.
    """

    source: Annotated[Path, tyro.conf.Positional]


@dataclass(frozen=True)
class CoeffsRetargetConfig:
    """Convert a table of one model to another model, and print the residual.

    Attributes:
        source: Table of coefficients (.h5).
        to: The other model: `builtin`, or a model file.
        out: Table to write (.h5).
        from_model: The model of the table.
        through: How the two models are related: `dense` by the nearest points of their mean faces, `landmarks` by
            the 68 landmarks alone.
    """

    source: Annotated[Path, tyro.conf.arg(name="from")]
    to: str
    out: Path
    from_model: str = BUILTIN_MODEL
    through: Through = "dense"


def coeffs(
    command: Annotated[
        Annotated[CoeffsConvertConfig, tyro.conf.subcommand("convert", prefix_name=False)]
        | Annotated[CoeffsInfoConfig, tyro.conf.subcommand("info", prefix_name=False)]
        | Annotated[CoeffsRetargetConfig, tyro.conf.subcommand("retarget", prefix_name=False)],
        tyro.conf.arg(name=""),
    ],
) -> int:
    """Convert coefficient files into a table, describe a table, or convert it to another model."""
    if isinstance(command, CoeffsConvertConfig):
        return _run(ConversionJob(command.source, "300wlp", command.model), command)
    return _info(command) if isinstance(command, CoeffsInfoConfig) else _retarget(command)


def fit(config: Annotated[FitConfig, tyro.conf.arg(name="")]) -> int:
    """Fit a model to photographs with annotated landmarks: camera, identity and expression of each face."""
    return _run(ConversionJob(config.landmarks, "annotated", config.model), config)


def _run(job: ConversionJob, config: _ConversionConfig) -> int:
    check_max_rejected(config.max_rejected)
    if config.workers < 1:
        raise UsageError(f"expected at least one worker (--workers), found {config.workers}")
    check_output_file(config.out, (".h5",))
    model, source = open_job(job)
    n = len(source.sample_ids)
    say(console, f"{counted(n, 'face')} in {job.folder}; model: {model.name} ({model.sha256[:12]})")
    place = process_pool(config.workers) if config.workers > 1 else nullcontext()
    with place as executor, progress_bar(console, "reading", n) as advance:
        summary = convert(job, config.out, executor, advance)
    return _report(summary, config)


def _report(summary: ConversionSummary, config: _ConversionConfig) -> int:
    say(console, f"{counted(summary.n_faces, 'face')} -> {config.out}")
    if summary.rejected:
        say(console, f"{len(summary.rejected)} rejected, listed in {rejected_path(config.out)}:")
        for reason, count in group_reasons(summary.rejected)[:SHOWN_REASONS]:
            say(console, f"  {count} x {reason}")
    model = "" if config.model == BUILTIN_MODEL else f" --model {config.model}"
    say(console, f"next: datagen coeffs info {config.out}; datagen render --coeffs {config.out}{model} --out shards/")
    return EXIT_REJECTED if len(summary.rejected) > config.max_rejected else 0


def _info(config: CoeffsInfoConfig) -> int:
    if config.source.is_dir():
        n = len(coefficient_paths(config.source))
        if not n:
            raise UsageError(f"{config.source}: expected .mat files of 300W-LP or AFLW2000-3D, found none")
        with progress_bar(console, "reading", n) as advance:
            summary = summarise_folder(config.source, advance)
    elif config.source.is_file():
        summary = summarise_table(load_coefficients(config.source))
    else:
        raise UsageError(
            f"{config.source}: expected a table (.h5) or a folder of coefficient files, found nothing there"
        )
    _print(summary, config.source)
    return 0


def _print(summary: CoefficientSummary, source: Path) -> None:
    table = Table(show_header=False, title=Text(printable(source.name)))
    table.add_column()
    table.add_column(overflow="fold")
    for name, value in summary.facts.items():
        table.add_row(name, Text(printable(value)))
    table.add_row("rejected", str(sum(count for _, count in summary.reasons)))
    for reason, count in summary.reasons[:SHOWN_REASONS]:
        table.add_row("", Text(printable(f"{count} x {reason}")))
    out = Console()
    out.print(table)
    print_statistics(out, summary.statistics)


def _retarget(config: CoeffsRetargetConfig) -> int:
    check_output_file(config.out, (".h5",))
    source, target = open_model(config.from_model), open_model(config.to)
    table, residual = transfer_table(load_coefficients(config.source), source, target, config.through)
    paths = (moved_path(path, config.source.parent, config.out.parent) for path in table.image_paths)
    table = replace(table, image_paths=tuple(paths))
    save_coefficients(table, config.out)
    say(
        console,
        f"{counted(len(table), 'face')} of {source.name} -> {target.name} by {residual.n_points} points "
        f"({residual.through}): residual {residual.mean_mm:.2f} mm mean, {residual.percentile_95_mm:.2f} mm at 95 % "
        f"(mean faces {residual.alignment_mm:.2f} mm apart); RMS of the coefficients {residual.rms:.2f}",
    )
    say(console, f"-> {config.out}")
    return 0
