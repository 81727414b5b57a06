"""The commands of ``datagen`` that look at shards: preview, stats, card, export."""

from json import dumps

from rich.console import Console

from datagen.datagen_config import CardConfig, ExportConfig, PreviewConfig, StatsConfig
from datagen.inspection.croissant import write_descriptions
from datagen.inspection.preview import contact_sheet, spread_samples
from datagen.inspection.preview_page import preview_page
from datagen.inspection.sample_counts import count_samples
from datagen.inspection.sample_export import export_samples
from datagen.inspection.statistics_tables import (
    picture_png,
    print_statistics,
    print_summary,
    statistics_page,
    statistics_picture,
)
from pix2face.command_line import check_output_file, counted, prepare_output_folder, printable, progress_bar, say
from pix2face.errors import UsageError
from pix2face.files.images import write_picture
from pix2face.files.writing import write_file
from pix2face.shards.shard_reader import ShardReader, shard_paths

console = Console(stderr=True)
N_ON_A_SHEET, N_ON_A_PAGE = 16, 24


def preview(config: PreviewConfig) -> int:
    """Runs ``datagen preview``."""
    shards, n = config.shards, config.n
    out = config.out or shards / "preview.jpg"
    if n is not None and n < 1:
        raise UsageError(f"expected at least one sample to show (--n), found {n}")
    check_output_file(out, (".jpg", ".jpeg", ".png", ".html"))
    if out.suffix.lower() == ".html":
        page = preview_page(printable(f"Samples of {shards}"), spread_samples(shards, n or N_ON_A_PAGE))
        write_file(out, page)
        say(console, f"page ({len(page) / 1e6:.1f} MB) -> {out}")
        return 0
    sheet = contact_sheet(shards, n or N_ON_A_SHEET)
    write_picture(out, sheet)
    say(console, f"contact sheet -> {out}")
    return 0


def stats(config: StatsConfig) -> int:
    """Runs ``datagen stats``."""
    shards, out = config.shards, config.out
    if out is not None:
        check_output_file(out, (".html", ".png"))
    with progress_bar(console, "counting", len(shard_paths(shards))) as advance:
        found = count_samples(shards, advance, config.where)
    if config.json:
        print(dumps(found.as_json(), indent=2))
    else:
        print(f"{counted(found.n_samples, 'sample')} in {counted(found.n_shards, 'shard')}", flush=True)
        (print_statistics if config.everything else print_summary)(Console(), found)
    if out is not None:
        if out.suffix.lower() == ".html":
            write_file(out, statistics_page(printable(f"Statistics of {shards}"), found))
        else:
            write_file(out, picture_png(statistics_picture(found)))
        say(console, f"statistics -> {out}")
    return 0


def card(config: CardConfig) -> int:
    """Runs ``datagen card``."""
    card, description = write_descriptions(config.shards)
    say(console, f"card -> {card}")
    say(console, f"description (Croissant) -> {description}")
    return 0


def export(config: ExportConfig) -> int:
    """Runs ``datagen export``."""
    shards, out = config.shards, config.out
    n_samples = sum(len(ShardReader(path)) for path in shard_paths(shards))
    prepare_output_folder(out)
    n_kept = 0
    with progress_bar(console, "exporting", n_samples) as advance:

        def on_sample(is_done: bool) -> None:
            nonlocal n_kept
            n_kept += is_done
            advance(n_kept, already_done=True) if is_done else advance()

        export_samples(shards, out, config.format, on_sample)
    kept = f" ({n_kept} there already)" if n_kept else ""
    say(console, f"{counted(n_samples, 'sample')}{kept} -> {out}")
    return 0
