"""The commands of ``datagen`` that sum shards up: stats, card."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text

from datagen.inspection.dataset_card import write_card
from datagen.inspection.dataset_statistics import DatasetStatistics
from datagen.inspection.sample_counts import count_samples
from datagen.inspection.statistics_tables import listings, picture_png, statistics_page, statistics_picture
from pix2face.command_line import check_output_file, counted, printable, progress_bar, say
from pix2face.shards.shard_reader import shard_paths

console = Console(stderr=True)


@dataclass(frozen=True)
class StatsConfig:
    """Configuration of ``datagen stats``."""

    shards: Annotated[Path, tyro.conf.Positional]
    """Folder of shards."""
    out: Path | None = None
    """A page (.html) or a picture (.png) to write, beside what is printed."""
    json: bool = False
    """Print everything as JSON instead of tables."""
    where: str = ""
    """Count only samples whose attributes fulfil this, such as "abs(yaw_deg) < 60"; as in ``train``."""


def stats(config: Annotated[StatsConfig, tyro.conf.arg(name="")]) -> int:
    """Count pose, face size, coefficients, landmarks and attributes of a folder of shards, and name what is rare."""
    if config.out is not None:
        check_output_file(config.out, (".html", ".png"))
    with progress_bar(console, "counting", len(shard_paths(config.shards))) as advance:
        found = count_samples(config.shards, advance, config.where)
    if config.json:
        print(json.dumps(found.as_json(), indent=2))
    else:
        _show(Console(), found)
    if config.out is not None:
        config.out.parent.mkdir(parents=True, exist_ok=True)
        if config.out.suffix.lower() == ".html":
            page = statistics_page(printable(f"Statistics of {config.shards}"), found)
            config.out.write_text(page, encoding="utf-8")
        else:
            config.out.write_bytes(picture_png(statistics_picture(found)))
        say(console, f"statistics -> {config.out}")
    return 0


@dataclass(frozen=True)
class CardConfig:
    """Configuration of ``datagen card``."""

    shards: Annotated[Path, tyro.conf.Positional]
    """Folder of shards."""


def card(config: Annotated[CardConfig, tyro.conf.arg(name="")]) -> int:
    """Write the card of a folder of shards into it: content, sources, what may not be passed on, how to read it.

    ``datagen render`` does so at its end.
    """
    say(console, f"card -> {write_card(config.shards)}")
    return 0


def _show(out: Console, found: DatasetStatistics) -> None:
    out.print(f"{counted(found.n_samples, 'sample')} in {counted(found.n_shards, 'shard')}")
    for listed in listings(found):
        table = Table(title=Text(printable(listed.title)), title_justify="left")
        for place, column in enumerate(listed.columns):
            table.add_column(Text(column), justify="right" if place else "left")
        for line in listed.lines:
            table.add_row(*(Text(printable(text)) for text in line))
        out.print(table)
    rare = found.rare()
    out.print(
        "rare, less than 1 % of the samples each (neighbouring ranges are summed):" if rare else "nothing is rare"
    )
    for text in rare:
        out.print(Text(printable(f"  {text}")), soft_wrap=True)
