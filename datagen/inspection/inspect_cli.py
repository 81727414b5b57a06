"""The commands of ``datagen`` that look at shards: verify, preview."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import tyro
from rich.console import Console

from datagen.inspection.preview import contact_sheet, spread_triplets
from datagen.inspection.preview_page import preview_page
from pix2face.command_line import EXIT_ERROR, check_output_file, counted, printable, progress_bar, say
from pix2face.errors import UsageError
from pix2face.shards.shard_checks import verify_folder
from pix2face.shards.shard_reader import shard_paths

console = Console(stderr=True)
N_ON_A_SHEET, N_ON_A_PAGE = 16, 24


@dataclass(frozen=True)
class VerifyConfig:
    """Configuration of ``datagen verify``."""

    shards: Annotated[Path, tyro.conf.Positional]
    """Folder of shards."""


@dataclass(frozen=True)
class PreviewConfig:
    """Configuration of ``datagen preview``."""

    shards: Annotated[Path, tyro.conf.Positional]
    """Folder of shards."""
    out: Path | None = None
    """What to write: a contact sheet (.jpg or .png), or a page to go through samples and layers (.html). Without it
    ``preview.jpg`` in the folder."""
    n: int | None = None
    """Samples to show, evenly spread. Without it 16 on a sheet, 24 on a page."""


def verify(config: Annotated[VerifyConfig, tyro.conf.arg(name="")]) -> int:
    """Read every sample of a folder of shards and check it.

    Checked are schema, checksums, ranges, pictures, mask and depth and other layers against each other, ids that occur
    twice, shards of another job, and shards that the job has not made.
    """
    n_shards = len(shard_paths(config.shards))
    with progress_bar(console, "verifying", n_shards) as advance:
        report = verify_folder(config.shards, advance)
    for problem in report.problems:
        print(printable(problem))
    if not report.problems:
        print(f"{counted(n_shards, 'shard')}, {counted(report.n_samples, 'sample')}: no problem found")
        return 0
    delete = "delete the damaged shards and " if report.damaged else ""
    print(
        f"{counted(len(report.problems), 'problem')}; {delete}run the same `datagen render` again: "
        "it writes what is missing"
    )
    if report.damaged:
        print(printable(f"  rm {' '.join(shlex.quote(str(path)) for path in report.damaged)}"))
    return EXIT_ERROR


def preview(config: Annotated[PreviewConfig, tyro.conf.arg(name="")]) -> int:
    """Draw samples and their layers: as a contact sheet, or as an HTML page (--out page.html) to go through them.

    A page is one file with its pictures in it: arrow keys change sample and layer, a slider blends layer and picture.
    Landmarks are green where visible, red where hidden.
    """
    out = config.out or config.shards / "preview.jpg"
    if config.n is not None and config.n < 1:
        raise UsageError(f"expected at least one sample to show (--n), found {config.n}")
    check_output_file(out, (".jpg", ".jpeg", ".png", ".html"))
    if out.suffix.lower() == ".html":
        samples = spread_triplets(config.shards, config.n or N_ON_A_PAGE)
        page = preview_page(printable(f"Samples of {config.shards}"), samples)
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(page, encoding="utf-8")
        say(console, f"page ({len(page) / 1e6:.1f} MB) -> {out}")
        return 0
    sheet = contact_sheet(config.shards, config.n or N_ON_A_SHEET)
    out.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(out), sheet[..., ::-1]):
        raise UsageError(f"{out}: expected a file that can be written, found that it cannot")
    say(console, f"contact sheet -> {out}")
    return 0
