"""The command ``evaluate compare``: two reports of the same benchmark."""

import json
from dataclasses import asdict

from rich.console import Console

from pix2face.command_line import check_output_file, counted, say
from pix2face.errors import UsageError
from pix2face.evaluation.evaluate_config import CompareConfig
from pix2face.evaluation.figures.bootstrap import CONFIDENCE, Bootstrap, Interval
from pix2face.evaluation.report.compare import Comparison, PointComparison, StoredReport, compare_reports, read_report
from pix2face.evaluation.report.report_text import terminal_table
from pix2face.evaluation.report.table_text import number
from pix2face.files.writing import write_file


def compare(config: CompareConfig) -> int:
    """Runs ``evaluate compare``."""
    if config.resamples < 1 or config.seed < 0:
        raise UsageError(f"expected --resamples from 1 and --seed from 0, found {config.resamples} and {config.seed}")
    if config.out is not None:
        check_output_file(config.out, (".json",))
    a, b = (read_report(path / "report.json" if path.is_dir() else path) for path in config.reports)
    bootstrap = Bootstrap(config.resamples, config.seed)
    comparison = compare_reports(a, b, bootstrap)
    console = Console()
    console.print(terminal_table(a.benchmark["title"], *_cells(comparison)))
    for note in _notes(a, b, comparison, bootstrap):
        say(console, note)
    if config.out is not None:
        facts = {"a": str(a.path), "b": str(b.path), "bootstrap": asdict(bootstrap), **asdict(comparison)}
        write_file(config.out, json.dumps(facts, indent=1, allow_nan=False))
    return 0


def _cells(comparison: Comparison) -> tuple[list[str], list[list[str]]]:
    columns = ["in %", *(f"{points} points" for points in comparison.points)]
    rows = [_figures(own) for own in comparison.points.values()]
    return columns, [[name, *(row[name] for row in rows)] for name in rows[0]]


def _figures(own: PointComparison) -> dict[str, str]:
    return {
        "mean of A": number(own.mean_a),
        "mean of B": number(own.mean_b),
        "B - A": _with_interval(own.difference, own.intervals["difference"]),
        "B better": number(own.share_b_better),
        "A better": number(own.share_a_better),
        "AUC, B - A": _with_interval(own.difference_of_area, own.intervals["difference_of_area"]),
        "failures, B - A": _with_interval(own.difference_of_failure_rate, own.intervals["difference_of_failure_rate"]),
        "found by both": str(own.n_both_found),
    }


def _notes(a: StoredReport, b: StoredReport, comparison: Comparison, bootstrap: Bootstrap) -> list[str]:
    benchmark = a.benchmark
    notes = [
        f"{name}: {report.path} ({report.method}; box: {report.benchmark['box_rule']}; landmarks: {report.landmarks})"
        for name, report in (("A", a), ("B", b))
    ]
    notes.append(
        f"Split {benchmark['split']}, truth {benchmark['truth']}, normaliser {benchmark['normaliser']}, threshold "
        f"{100 * float(benchmark['threshold']):g} %."
    )
    if comparison.only_a or comparison.only_b:
        notes.append(
            f"NOT of the same images: {comparison.n_common} in common (all figures are over these), "
            f"{len(comparison.only_a)} in A alone, {len(comparison.only_b)} in B alone."
        )
    else:
        notes.append(f"Both are of the same {counted(comparison.n_common, 'image')}.")
    notes.append(
        f"Means are over the images that both found; shares, AUC and failures over all in common. Brackets: "
        f"{100 * CONFIDENCE:g} % intervals, paired bootstrap, {bootstrap.n_resamples} resamples of "
        f"{comparison.n_drawn} images or clips, seed {bootstrap.seed}."
    )
    return [*notes, _verdict(comparison.points["68"], comparison.n_common)]


def _verdict(own: PointComparison, n_common: int) -> str:
    if own.n_both_found == n_common:
        return _of_interval(own.intervals["difference"], "means", "68 points", smaller_is_better=True)
    # Who finds the easy faces alone has the smaller mean: the area counts a face that is not found as a failure.
    verdict = _of_interval(own.intervals["difference_of_area"], "AUC", "68 points, all images", smaller_is_better=False)
    return (
        f"{verdict} Both found {own.n_both_found} of {counted(n_common, 'image')}; over all of them A is better on "
        f"{number(own.share_a_better)} %, B on {number(own.share_b_better)} %."
    )


def _of_interval(interval: Interval | None, of_what: str, where: str, *, smaller_is_better: bool) -> str:
    if interval is None:
        return "Too few images for an interval."
    if interval[0] <= 0 <= interval[1]:
        return f"The difference of the {of_what} ({where}) may be chance: its interval holds 0."
    better = "B" if (interval[1] < 0) == smaller_is_better else "A"
    return f"{better} is better ({where}): the interval of the difference of the {of_what} excludes 0."


def _with_interval(value: float | None, interval: Interval | None) -> str:
    if value is None or interval is None:
        return number(value)
    return f"{100 * value:+.2f} ({100 * interval[0]:+.2f} to {100 * interval[1]:+.2f})"
