"""Statistics as tables and pictures, for a terminal and for a page."""

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING, final

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from datagen.inspection.dataset_statistics import CoefficientStatistics, DatasetStatistics, Histogram
from pix2face.command_line import printable, say
from pix2face.files.html_parts import data_url

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

N_KINDS_SHOWN = 24
# With these, the summary of the largest set has 90 lines: two screens.
N_ATTRIBUTES_SHOWN, N_DOUBTS_SHOWN, N_SIZES_SHOWN = 32, 4, 3


@final
@dataclass(frozen=True)
class Listing:
    """A table of texts: its title, the headings of its columns, and its lines."""

    title: str
    columns: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]


def listings(found: DatasetStatistics) -> list[Listing]:
    """Everything that was counted, as tables. What the set lacks has no table."""
    tables = [_histogram_listing(histogram) for histogram in found.histograms]
    tables += _faces_and_pictures(found)
    for name, kinds in found.kinds.items():
        lines = _most(kinds, found.n_samples) or (("too many values to list", "", ""),)
        tables.append(Listing(f"attribute {name}", ("value", "samples", "share"), lines))
    numbers = tuple((name, *(f"{value:.4g}" for value in values)) for name, values in found.numbers.items())
    tables.append(Listing("attributes that are numbers", ("attribute", "smallest", "mean", "largest"), numbers))
    tables.append(Listing("ground truth that cannot be true", ("sample", "doubt"), _first(found.doubtful)))
    return [table for table in tables if table.lines]


def summary(found: DatasetStatistics) -> list[Listing]:
    """What matters first, on two screens: doubts, then a line for each quantity and each text attribute."""
    known = [histogram for histogram in found.histograms if histogram.counts.any()]
    quantities = tuple((own.name, own.middle(), *_most_frequent(own)) for own in known)
    attributes = tuple(
        (name, str(len(kinds)), *_most(kinds, found.n_samples)[0][::2], str(len(found.rare_kinds(name))))
        for name, kinds in found.kinds.items()
        if kinds
    )
    n_more = len(attributes) - N_ATTRIBUTES_SHOWN
    more = ((f"{n_more} more", "", "", "", ""),) if n_more > 0 else ()
    columns = ("attribute", "values", "most frequent", "share", "rare values")
    tables = [
        Listing("ground truth that cannot be true", ("sample", "doubt"), _first(found.doubtful, N_DOUBTS_SHOWN)),
        Listing("poses, sizes and distances", ("quantity", "middle 90 %", "most frequent", "share"), quantities),
        *_faces_and_pictures(found, N_SIZES_SHOWN),
        Listing("attributes that are texts", columns, attributes[:N_ATTRIBUTES_SHOWN] + more),
    ]
    return [table for table in tables if table.lines]


def print_summary(out: Console, found: DatasetStatistics) -> None:
    """Prints what matters first, and which ranges are rare."""
    _print_tables(out, summary(found))
    _print_rare(out, found.rare_ranges())
    numbers = f"{len(found.numbers)} attributes are numbers; " if found.numbers else ""
    out.print(f"{numbers}--all prints everything that was counted")


def print_statistics(out: Console, found: DatasetStatistics) -> None:
    """Prints all tables, and what is rare."""
    _print_tables(out, listings(found))
    _print_rare(out, found.rare())


def _print_tables(out: Console, tables: Iterable[Listing]) -> None:
    for listed in tables:
        out.print(Text(printable(listed.title), style="italic"), soft_wrap=True)
        table = Table()
        for place, column in enumerate(listed.columns):
            table.add_column(Text(column), justify="right" if place else "left", overflow="fold")
        for line in listed.lines:
            table.add_row(*(Text(printable(text)) for text in line))
        out.print(table)


def _print_rare(out: Console, rare: Sequence[str]) -> None:
    out.print(
        "rare, less than 1 % of the samples each (neighbouring ranges are summed):" if rare else "nothing is rare"
    )
    for text in rare:
        say(out, f"  {text}")


def statistics_picture(found: DatasetStatistics) -> "matplotlib.figure.Figure":
    """Bars of pose, face size, distance, coefficients and landmarks."""
    from matplotlib.figure import Figure  # half a second, which commands that draw no figure save

    figure = Figure(figsize=(12, 7), layout="constrained")
    axes = iter(figure.subplots(2, 4).flat)
    for histogram in found.histograms:
        _draw_histogram(next(axes), histogram)
    for one in found.coefficients:
        axis = next(axes)
        axis.bar(np.arange(len(one.rms)), one.rms, width=1.0)
        axis.axhline(1.0, color="black", linewidth=0.8)
        axis.set(title=f"{one.name}, RMS of each component", xlabel="component", ylabel="standard deviations")
    if len(found.visible_share):
        axis = next(axes)
        axis.bar(np.arange(len(found.visible_share)), 100 * found.visible_share, width=1.0)
        axis.set(title="landmarks seen", xlabel="landmark, from 0", ylabel="% of samples", ylim=(0, 100))
    for axis in axes:
        axis.remove()
    return figure


def picture_png(figure: "matplotlib.figure.Figure") -> bytes:
    """The content of a PNG file; the same figure gives the same bytes."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=100, metadata={"Software": None})
    return content.getvalue()


def statistics_page(title: str, found: DatasetStatistics) -> str:
    """Picture, tables and what is rare as one HTML page; every text is escaped."""
    rare = "\n".join(f"<li>{escape(line)}</li>" for line in found.rare()) or "<li>nothing</li>"
    texts = {
        "title": escape(title),
        "size": f"{found.n_samples} samples in {found.n_shards} shards",
        "picture": data_url("png", picture_png(statistics_picture(found))),
        "rare": rare,
        "tables": "\n".join(_table_html(table) for table in listings(found)),
    }
    return Template(own_file("statistics.html")).substitute(texts)


def own_file(name: str) -> str:
    """A template of a page, or a part of one."""
    return (files("datagen.inspection") / "pages" / name).read_text(encoding="utf-8")


def _faces_and_pictures(found: DatasetStatistics, n_sizes: int = N_KINDS_SHOWN) -> list[Listing]:
    columns = ("basis", "components", "RMS (lowest, highest)", "beyond 3 sd", "most (component)", "largest")
    coefficients = tuple(_coefficient_line(one) for one in found.coefficients if len(one.rms))
    parts = tuple((name, _per_cent(share)) for name, share in found.visible_parts().items())
    sizes = _most(found.picture_sizes, found.n_samples, n_sizes)
    return [
        Listing("coefficients, standard deviations", columns, coefficients),
        Listing("landmarks seen", ("part", "share"), parts),
        Listing("pictures", ("width x height, px", "samples", "share"), sizes),
    ]


def _most_frequent(histogram: Histogram) -> tuple[str, str]:
    """The range with the most samples, and its share."""
    most = int(histogram.counts.argmax())
    return histogram.range_name(most, most), _per_cent(histogram.counts[most] / histogram.n_samples)


def _histogram_listing(histogram: Histogram) -> Listing:
    used = np.flatnonzero(histogram.counts)
    shown = range(int(used.min()), int(used.max()) + 1)
    lines = tuple(
        (histogram.range_name(i, i), str(histogram.counts[i]), _per_cent(histogram.counts[i] / histogram.n_samples))
        for i in shown
    )
    return Listing(histogram.name, ("range", "samples", "share"), lines)


def _coefficient_line(one: CoefficientStatistics) -> tuple[str, ...]:
    most = int(one.far_share.argmax())
    rms = float(np.sqrt((one.rms**2).mean()))
    return (
        one.name,
        str(len(one.rms)),
        f"{rms:.2f} ({one.rms.min():.2f}, {one.rms.max():.2f})",
        _per_cent(float(one.far_share.mean())),
        f"{_per_cent(float(one.far_share[most]))} ({most})",
        f"{one.largest:.1f}",
    )


def _most(counts: Mapping[str, int], n_samples: int, n_shown: int = N_KINDS_SHOWN) -> tuple[tuple[str, ...], ...]:
    """The most frequent values, and all others together; ``counts`` is in order of frequency."""
    ordered = list(counts.items())
    lines = [(value, str(n), _per_cent(n / n_samples)) for value, n in ordered[:n_shown]]
    if len(ordered) > n_shown:
        n = sum(n for _, n in ordered[n_shown:])
        lines.append((f"{len(ordered) - n_shown} others", str(n), _per_cent(n / n_samples)))
    return tuple(lines)


def _first(lines: tuple[tuple[str, str], ...], n_shown: int = N_KINDS_SHOWN) -> tuple[tuple[str, ...], ...]:
    others = ((f"{len(lines) - n_shown} others", ""),) if len(lines) > n_shown else ()
    return lines[:n_shown] + others


def _draw_histogram(axis: "matplotlib.axes.Axes", histogram: Histogram) -> None:
    share = 100 * histogram.counts / histogram.n_samples
    # All bars are equally wide: to scale, the outer ranges of angles and the upper ones of sizes would hide the rest.
    axis.bar(np.arange(len(share)), share, width=1.0, align="edge", edgecolor="white")
    step = 2
    labels = ["more" if np.isinf(edge) else f"{edge:g}" for edge in histogram.edges[::step]]
    axis.set_xticks(np.arange(0, len(share) + 1, step), labels, rotation=60)
    axis.axhline(1.0, color="black", linewidth=0.8, linestyle=":")
    axis.set(title=histogram.name, xlabel=histogram.unit, ylabel="% of samples")


def _table_html(table: Listing) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in table.columns)
    body = "\n".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in line) + "</tr>" for line in table.lines)
    return f"<table><caption>{escape(table.title)}</caption>\n<tr>{head}</tr>\n{body}\n</table>"


def _per_cent(share: float) -> str:
    return f"{100 * share:.2f} %"
