"""The command ``datagen``: sample or fit faces, render triplets, verify and look at shards, import models."""

import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from datagen.coeffs_cli import coeffs, fit
from datagen.doctor_cli import doctor
from datagen.inspect_cli import preview, verify
from datagen.model_cli import describe, model
from datagen.pipeline import REJECTED_FILE, JobSummary, RenderJob, run_job
from datagen.sampling import sample_faces
from datagen.sources import open_source
from pix2face.coefficients import save_coefficients
from pix2face.command_line import (
    EXIT_REJECTED,
    check_max_rejected,
    check_output_file,
    counted,
    prepare_output_folder,
    progress_bar,
    run_commands,
    say,
)
from pix2face.errors import UsageError
from pix2face.morphable_model import BUILTIN_MODEL, open_model

console = Console(stderr=True)


@dataclass(frozen=True)
class SampleConfig:
    """Configuration of ``datagen sample``."""

    out: Path
    """Table of coefficients to write (.h5)."""
    n: int = 400
    """Number of faces."""
    seed: int = 0
    """Seed of identities, expressions, poses and cameras. 0 is a seed like any other."""
    size: int = 256
    """Side of the pictures to be rendered, in pixels."""
    model: str = BUILTIN_MODEL
    """``builtin``, or a model file made by ``datagen model import``."""


@dataclass(frozen=True)
class RenderConfig:
    """Configuration of ``datagen render``."""

    coeffs: Path
    """Folder of 300W-LP or AFLW2000-3D files (with subfolders), or a table made by ``datagen sample``."""
    out: Path
    """Folder of the shards. Run again with the same settings, it is completed. Other settings are refused, another
    table, and a folder in which a file has come, gone, or changed its size; not one edited to the same size."""
    model: str = BUILTIN_MODEL
    """``builtin``, or a model file made by ``datagen model import``. With an imported BFM 2009 the coefficients of
    300W-LP are used as they are; any other model is fitted to the landmarks of the files."""
    seed: int = 0
    """Seed of light, colours and background of rendered pictures."""
    shard_size: int = 100
    """Samples in a shard."""
    workers: int = os.cpu_count() or 1
    """Processes that render."""
    max_rejected: int = 0
    """How many samples may be rejected before the exit status says so (3)."""


def sample(config: Annotated[SampleConfig, tyro.conf.arg(name="")]) -> int:
    """Draw plausible faces, poses and cameras, and write them as a table of coefficients."""
    check_output_file(config.out, (".h5",))
    table = sample_faces(open_model(config.model), config.n, config.seed, config.size)
    save_coefficients(table, config.out)
    say(console, f"{counted(len(table), 'face')} of {table.model_name} -> {config.out}")
    say(console, f"next: datagen render --coeffs {config.out} --out shards/")
    return 0


def render(config: Annotated[RenderConfig, tyro.conf.arg(name="")]) -> int:
    """Render image / PNCC / offset triplets into sharded HDF5. One bad sample never ends the job."""
    check_max_rejected(config.max_rejected)
    if config.workers < 1 or config.shard_size < 1 or config.seed < 0:
        raise UsageError(
            "expected --workers and --shard-size of at least 1 and --seed of at least 0, "
            f"found {config.workers}, {config.shard_size} and {config.seed}"
        )
    chosen = open_model(config.model)
    source = open_source(config.coeffs, chosen)
    say(console, f"{counted(len(source.sample_ids), 'face')} in {config.coeffs}; model: {describe(chosen)}")
    if config.coeffs.is_dir() and config.model == BUILTIN_MODEL:
        say(
            console,
            "the coefficients are BFM's: the built-in model is fitted to the landmarks of the files instead "
            "(have BFM 2009? datagen model import, then --model)",
        )
    job = RenderJob(config.coeffs, config.model, config.seed, config.shard_size)
    prepare_output_folder(config.out)
    # Work is spread over processes: threads inside one (of software GL, of linear algebra) would only fight for cores.
    for variable in ("LP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    context = multiprocessing.get_context("spawn")
    with (
        progress_bar(console, "rendering", len(source.sample_ids)) as advance,
        ProcessPoolExecutor(config.workers, mp_context=context) as executor,
    ):
        summary = run_job(job, config.out, executor, advance)
    return _report(summary, config)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``datagen``."""
    commands: dict[str, Callable[..., int]] = {
        "sample": sample,
        "render": render,
        "verify": verify,
        "preview": preview,
        "doctor": doctor,
        "model": model,
        "coeffs": coeffs,
        "fit": fit,
    }
    return run_commands(
        "datagen", "Ground truth for dense 3D faces: coefficients in, triplets out.", commands, arguments
    )


def _report(summary: JobSummary, config: RenderConfig) -> int:
    kept = f" ({summary.n_shards_kept} there already)" if summary.n_shards_kept else ""
    made = f"{counted(summary.n_triplets, 'triplet')} in {counted(summary.n_shards, 'shard')}"
    say(console, f"{made}{kept} -> {config.out}")
    if summary.rejected:
        say(
            console,
            f"{counted(len(summary.rejected), 'sample')} rejected, listed in {config.out / REJECTED_FILE}; the first:",
        )
        say(console, f"  {summary.rejected[0][1]}")
    say(console, f"next: datagen preview {config.out}; train --shards {config.out}")
    return EXIT_REJECTED if len(summary.rejected) > config.max_rejected else 0


if __name__ == "__main__":
    sys.exit(main())
