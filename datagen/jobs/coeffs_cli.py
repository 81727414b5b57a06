"""The commands ``datagen coeffs`` and ``datagen fit``: tables of coefficients from folders, and between models."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from datagen.datagen_config import (
    CoeffsCommand,
    CoeffsConvertConfig,
    CoeffsInfoConfig,
    CoeffsRetargetConfig,
    ConversionConfig,
    FitConfig,
)
from datagen.faces.model_transfer import transfer_table
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
from pix2face.models import BUILTIN_MODEL
from pix2face.models.morphable_model import open_model

console = Console(stderr=True)
SHOWN_REASONS = 10


def coeffs(command: CoeffsCommand) -> int:
    """Runs ``datagen coeffs``."""
    if isinstance(command, CoeffsConvertConfig):
        return _run(ConversionJob(command.source, "300wlp", command.model), command)
    return _info(command) if isinstance(command, CoeffsInfoConfig) else _retarget(command)


def fit(config: FitConfig) -> int:
    """Runs ``datagen fit``."""
    return _run(ConversionJob(config.landmarks, "annotated", config.model), config)


def _run(job: ConversionJob, config: ConversionConfig) -> int:
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


def _report(summary: ConversionSummary, config: ConversionConfig) -> int:
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
