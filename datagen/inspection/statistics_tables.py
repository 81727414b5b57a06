"""The statistics of a set as tables and pictures, for a terminal and for a page."""

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, final

import numpy as np

from datagen.inspection.dataset_statistics import CoefficientStatistics, DatasetStatistics, Histogram

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

N_KINDS_SHOWN = 12
_STYLE = """
body { font-family: sans-serif; margin: 2em auto; max-width: 75em; padding: 0 1em; color: #222; }
table { border-collapse: collapse; margin: 1em 0; } th, td { padding: .2em .8em; border-bottom: 1px solid #ccc; }
td, th { text-align: right; overflow-wrap: anywhere; } th:first-child, td:first-child { text-align: left; }
caption { text-align: left; font-weight: bold; } img { max-width: 100%; }
"""


@final
@dataclass(frozen=True)
class Listing:
    """A table of texts.

    Attributes:
        title: Above it.
        columns: Headings.
        lines: As many texts in each as there are headings.
    """

    title: str
    columns: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]


def listings(found: DatasetStatistics) -> list[Listing]:
    """Everything that was counted, as tables; what was not there has none."""
    tables = [_histogram_listing(histogram) for histogram in found.histograms]
    lines = tuple(_coefficient_line(one) for one in found.coefficients if len(one.rms))
    columns = ("basis", "n", "RMS (from, to)", "> 3 sd", "most, of one", "largest")
    tables.append(Listing("coefficients, standard deviations", columns, lines))
    parts = tuple((name, _per_cent(share)) for name, share in found.visible_parts().items())
    tables.append(Listing("landmarks seen", ("part", "share"), parts))
    sizes = _most(found.picture_sizes, found.n_samples)
    tables.append(Listing("pictures", ("width x height, px", "samples", "share"), sizes))
    for name, kinds in found.kinds.items():
        lines = _most(kinds, found.n_samples) or (("too many values to list", "", ""),)
        tables.append(Listing(f"attribute {name}", ("value", "samples", "share"), lines))
    numbers = tuple((name, *(f"{value:.4g}" for value in values)) for name, values in found.numbers.items())
    tables.append(Listing("attributes that are numbers", ("attribute", "smallest", "mean", "largest"), numbers))
    return [table for table in tables if table.lines]


def statistics_picture(found: DatasetStatistics) -> "matplotlib.figure.Figure":
    """Bars of pose, face size, coefficients and landmarks."""
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
    """A figure as the content of a PNG file; the same figure gives the same bytes."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=100, metadata={"Software": None})
    return content.getvalue()


def statistics_page(title: str, found: DatasetStatistics) -> str:
    """Picture, tables and what is rare as one HTML file; every text is escaped."""
    picture = base64.b64encode(picture_png(statistics_picture(found))).decode()
    rare = "\n".join(f"<li>{escape(line)}</li>" for line in found.rare()) or "<li>nothing</li>"
    tables = "\n".join(_table_html(table) for table in listings(found))
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>{escape(title)}</title><style>{_STYLE}</style></head><body>
<h1>{escape(title)}</h1>
<p>{found.n_samples} samples in {found.n_shards} shards.</p>
<p><img src="data:image/png;base64,{picture}" alt="Bars of pose, face size, coefficients and landmarks"></p>
<h2>Rare: less than 1 % of the samples each; neighbouring ranges are summed</h2>
<ul>
{rare}
</ul>
{tables}
</body></html>
"""


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


def _most(counts: Mapping[str, int], n_samples: int) -> tuple[tuple[str, ...], ...]:
    """The most frequent values, and the others together; ``counts`` has the most frequent first."""
    ordered = list(counts.items())
    lines = [(value, str(n), _per_cent(n / n_samples)) for value, n in ordered[:N_KINDS_SHOWN]]
    if len(ordered) > N_KINDS_SHOWN:
        n = sum(n for _, n in ordered[N_KINDS_SHOWN:])
        lines.append((f"{len(ordered) - N_KINDS_SHOWN} others", str(n), _per_cent(n / n_samples)))
    return tuple(lines)


def _draw_histogram(axis: "matplotlib.axes.Axes", histogram: Histogram) -> None:
    share = 100 * histogram.counts / histogram.n_samples
    # Every range is as wide as the next: the outer ones of angles, and the upper ones of sizes, would hide the rest.
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
