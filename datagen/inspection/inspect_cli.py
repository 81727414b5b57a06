"""The commands of ``datagen`` that look at shards: verify, preview, stats, card."""

import shlex
from json import dumps
from pathlib import Path
from typing import Annotated

import cv2
import tyro
from rich.console import Console

from datagen.inspection.dataset_card import write_card
from datagen.inspection.preview import contact_sheet, spread_samples
from datagen.inspection.preview_page import preview_page
from datagen.inspection.sample_counts import count_samples
from datagen.inspection.statistics_tables import picture_png, print_statistics, statistics_page, statistics_picture
from pix2face.command_line import EXIT_ERROR, check_output_file, counted, optional, printable, progress_bar, say
from pix2face.errors import UsageError
from pix2face.files.writing import write_file
from pix2face.shards.sample_truth import WHAT_TO_DO
from pix2face.shards.shard_checks import verify_folder
from pix2face.shards.shard_reader import shard_paths

console = Console(stderr=True)
N_ON_A_SHEET, N_ON_A_PAGE = 16, 24


def verify(shards: Annotated[Path, tyro.conf.Positional]) -> int:
    """Read every sample of a folder of shards and check it.

    This checks the schema, checksums, ranges and pictures, and whether layers agree. It also finds ids that occur
    twice, shards of another job and missing shards. For photographs, it finds ground truth that cannot be right:
    landmarks outside the picture, coefficients that no real face has, faces that look away from the camera, and
    pictures that an orientation tag turns.

    Args:
        shards: Folder of shards.
    """
    n_shards = len(shard_paths(shards))
    with progress_bar(console, "verifying", n_shards) as advance:
        report = verify_folder(shards, advance)
    for problem in (*report.problems, *report.doubtful):
        print(printable(problem))
    if not report.problems and not report.doubtful:
        print(f"{counted(n_shards, 'shard')}, {counted(report.n_samples, 'sample')}: no problem found")
        return 0
    if report.doubtful:
        print(f"{counted(len(report.doubtful), 'doubt')} about ground truth; {WHAT_TO_DO}")
    if not report.problems:
        return EXIT_ERROR
    delete = "delete the damaged shards and " if report.damaged else ""
    print(
        f"{counted(len(report.problems), 'problem')}; {delete}run the same `datagen render` again: "
        "it writes what is missing"
    )
    if report.damaged:
        print(printable(f"  rm {' '.join(shlex.quote(str(path)) for path in report.damaged)}"))
    return EXIT_ERROR


def preview(
    shards: Annotated[Path, tyro.conf.Positional],
    out: Annotated[Path | None, optional("PATH")] = None,
    n: Annotated[int | None, optional("INT")] = None,
) -> int:
    """Draw samples and their layers, on a contact sheet or on an HTML page (--out page.html).

    The page is one file with all its pictures. Arrow keys change the sample and the layer, and a slider blends layer
    and picture. Visible landmarks are green, and hidden ones are red. A landmark is hidden by the head itself or, if
    the set has the layer `seen`, by something in front of it.

    Args:
        shards: Folder of shards.
        out: File to write: a contact sheet (.jpg, .png) or a page (.html). Default: `preview.jpg` in the folder.
        n: Number of samples to show, evenly spread. Without this option, a sheet has 16 and a page 24.
    """
    out = out or shards / "preview.jpg"
    if n is not None and n < 1:
        raise UsageError(f"expected at least one sample to show (--n), found {n}")
    check_output_file(out, (".jpg", ".jpeg", ".png", ".html"))
    if out.suffix.lower() == ".html":
        page = preview_page(printable(f"Samples of {shards}"), spread_samples(shards, n or N_ON_A_PAGE))
        write_file(out, page)
        say(console, f"page ({len(page) / 1e6:.1f} MB) -> {out}")
        return 0
    sheet = contact_sheet(shards, n or N_ON_A_SHEET)
    write_file(out, cv2.imencode(out.suffix, sheet[..., ::-1])[1].tobytes())
    say(console, f"contact sheet -> {out}")
    return 0


def stats(
    shards: Annotated[Path, tyro.conf.Positional],
    out: Annotated[Path | None, optional("PATH")] = None,
    json: bool = False,
    where: Annotated[str, tyro.conf.arg(help_behavior_hint="")] = "",
) -> int:
    """Print statistics of poses, faces, landmarks and attributes of a folder of shards, and say what is rare.

    Args:
        shards: Folder of shards.
        out: Also write the statistics as a page (.html) or a picture (.png).
        json: Print everything as JSON instead of tables.
        where: Count only samples that fulfil this condition, such as "abs(yaw_deg) < 60", written as for `train`.
    """
    if out is not None:
        check_output_file(out, (".html", ".png"))
    with progress_bar(console, "counting", len(shard_paths(shards))) as advance:
        found = count_samples(shards, advance, where)
    if json:
        print(dumps(found.as_json(), indent=2))
    else:
        print(f"{counted(found.n_samples, 'sample')} in {counted(found.n_shards, 'shard')}", flush=True)
        print_statistics(Console(), found)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        if out.suffix.lower() == ".html":
            write_file(out, statistics_page(printable(f"Statistics of {shards}"), found))
        else:
            write_file(out, picture_png(statistics_picture(found)))
        say(console, f"statistics -> {out}")
    return 0


def card(shards: Annotated[Path, tyro.conf.Positional]) -> int:
    """Write a card into a folder of shards: its content and sources, what may not be passed on, and how to read it.

    `datagen render` also writes it when it is done.

    Args:
        shards: Folder of shards.
    """
    say(console, f"card -> {write_card(shards)}")
    return 0
