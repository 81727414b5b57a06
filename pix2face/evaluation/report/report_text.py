"""An evaluation as text: tables, and notes that explain them."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from pix2face.command_line import counted, printable
from pix2face.evaluation.figures.attribute_bins import ErrorsByAttribute
from pix2face.evaluation.figures.bootstrap import CONFIDENCE
from pix2face.evaluation.figures.pose_summary import ANGLES
from pix2face.evaluation.report.detection_text import detection_notes, detection_table
from pix2face.evaluation.report.evaluation_report import BASELINE_RULE, NORMALISERS, Report, ReportRow
from pix2face.evaluation.report.table_text import NO_FIGURE, SHORT_GROUPS, ReportTable, interval_text, number
from pix2face.geometry.landmark_metrics import ALIGNMENTS, ErrorSummary

N_NAMES_SHOWN = 10
METHODS = {
    "network": "landmarks of the fit to the maps",
    "predictions": "landmarks of another system, from its file",
    "oracle": "NOT A RESULT: the model fitted to the truth itself, to show how much of an error is the model's",
}
LANDMARK_TYPES = {
    "3d": "fixed points of the model",
    "2d": "as people mark them in photographs, with the jaw on the visible outline",
}


def main_table(report: Report) -> ReportTable:
    """The errors of the landmarks, in per cent."""
    groups = list(report.rows[0].groups)
    counted_on, threshold = f"{report.manifest.what_is_counted}s", f"{100 * report.manifest.threshold:g} %"
    is_binned = report.manifest.groups == "yaw"
    headings = [SHORT_GROUPS.get(group, group) for group in groups] if len(groups) > 1 else []
    columns = ["in %", "points", *headings, *(["mean of bins"] if is_binned else [])]
    columns += [f"mean of {counted_on}", "median", f"AUC to {threshold}", f"above {threshold}", "not found"]
    lines = [_line(row, with_groups=len(groups) > 1, is_binned=is_binned) for row in report.rows]
    counts = [counted_on, NO_FIGURE]
    counts += [str(report.rows[0].groups[group].n_images) for group in groups if len(groups) > 1]
    counts += [NO_FIGURE] * is_binned + [str(len(report.results)), *[NO_FIGURE] * 4]
    own_columns = "mean in each bin of |yaw|, unweighted mean of the bins" if is_binned else "mean in each part"
    caption = (
        f"Mean error of the landmarks, in % of {report.normaliser}, over all 68 points or the 51 inside the face. "
        f"Columns: {f'{own_columns}, ' if headings else ''}mean and median over all {counted_on}, area under "
        f"the error curve (AUC) up to {threshold}, share of {counted_on} with a larger error, number of faces that "
        "were not found."
    )
    return ReportTable(caption, columns, [*lines, counts])


def _interval_table(report: Report) -> ReportTable | None:
    if not report.settings.bootstrap.n_resamples:
        return None
    names = {"mean_of_groups": "mean of bins", "mean": "mean", "median": "median"}
    names |= {"area_under_curve": "AUC", "failure_rate": "above threshold"}
    if report.manifest.groups != "yaw":
        del names["mean_of_groups"]
    lines = [
        [row.method, row.points, *(interval_text(row.intervals.get(name)) for name in names)] for row in report.rows
    ]
    interval = f"{100 * CONFIDENCE:g} % interval"
    caption = f"{interval}s (bootstrap) of the figures above, in % of {report.normaliser}; AUC and failures in %."
    return ReportTable(caption, [f"{interval}, in %", "points", *names.values()], lines)


def _part_table(report: Report) -> ReportTable:
    parts = {method: report.mean_of_parts(method) for method in report.methods}
    lines = [[method, *(number(value) for value in own.values())] for method, own in parts.items()]
    caption = f"Mean error of each part of the face, in % of {report.normaliser}, over the faces that were found."
    return ReportTable(caption, ["in %", *next(iter(parts.values()))], lines)


def _table3d(report: Report) -> ReportTable | None:
    if not report.rows3d:
        return None
    threshold, is_share = report.manifest.threshold3d or 0, report.settings.alignment == "depth"
    factor, unit = (100, f"% of {report.unit3d}") if is_share else (1, "the data's unit")
    upper = f"{factor * threshold:g} %" if is_share else f"{threshold:g}, %"
    columns = ["distance in 3D", "points", "mean", "interval", "median", f"AUC to {upper}", "not found"]
    lines = []
    for row in report.rows3d:
        own = row.all_images
        figures = [
            number(own.mean, factor, 3),
            interval_text(row.intervals["mean"], factor),
            number(own.median, factor, 3),
        ]
        lines.append([row.method, row.points, *figures, number(own.area_under_curve, 100, 1), str(own.n_failed)])
    caption = f"Mean distance of the landmarks in 3D after alignment, in {unit}; AUC in %."
    return ReportTable(caption, columns, lines)


def _pose_table(report: Report) -> ReportTable | None:
    if report.poses is None:
        return None
    columns = ["pose, degrees", report.manifest.what_is_counted + "s"]
    columns += [f"{angle} {what}" for angle in ANGLES for what in ("MAE", "bias")]
    columns += ["mean of MAEs", "rotation", "|yaw| bias"]
    lines = []
    for name, own in report.poses.items():
        figures = [number(values[angle], 1) for angle in ANGLES for values in (own.mean_absolute_deg, own.bias_deg)]
        means = (own.mean_of_angles_deg, own.mean_rotation_deg, own.yaw_shrinkage_deg)
        figures += [number(value, 1) for value in means]
        lines.append([SHORT_GROUPS.get(name, name), str(own.n_images), *figures])
    caption = (
        "Errors of the head's pose in bins of the true |yaw|, in degrees. MAE: mean absolute error. Bias: mean of "
        "found minus true. Rotation: mean angle between the found and the true head."
    )
    return ReportTable(caption, columns, lines)


def _attribute_table(own: ErrorsByAttribute, report: Report) -> ReportTable:
    above = f"above {100 * report.manifest.threshold:g} %"
    columns = [f"{own.attribute}, in %", f"{report.manifest.what_is_counted}s", "mean", "interval", "median"]
    lines = []
    for row in own.bins:
        found = row.errors
        line = [row.name, str(found.n_images), number(found.mean), interval_text(row.interval), number(found.median)]
        lines.append([*line, number(found.failure_rate, digits=1), str(found.n_failed)])
    caption = f"Mean error over 68 points by {own.attribute}, in % of {report.normaliser}."
    return ReportTable(caption, [*columns, above, "not found"], lines)


def all_tables(report: Report) -> list[ReportTable]:
    """Every table that the report has, the main one first."""
    tables = (
        main_table(report),
        _interval_table(report),
        _part_table(report),
        _table3d(report),
        _pose_table(report),
        detection_table(report.detection),
        *(_attribute_table(own, report) for own in report.by),
    )
    return [table for table in tables if table is not None]


def report_tables(report: Report) -> list[Table]:
    """The tables for a terminal, the first below the title."""
    return [
        terminal_table("" if index else report.title, table.columns, table.lines)
        for index, table in enumerate(all_tables(report))
    ]


def terminal_table(title: str, columns: Sequence[str], lines: Sequence[Sequence[str]]) -> Table:
    """A table for a terminal in which no word is cut."""
    # Names and texts may come from shards, which anybody may have written.
    shown = [[printable(cell) for cell in line] for line in (columns, *lines)]
    table = Table(title=escape(title) or None, box=SIMPLE_HEAD, padding=0, show_edge=False)
    for index, cells in enumerate(zip(*shown, strict=True)):
        table.add_column(
            escape(cells[0]),
            justify="right" if index else "left",
            vertical="bottom",
            width=max(len(word) for word in (*cells[0].split(), *cells[1:])),
        )
    for line in shown[1:]:
        table.add_row(*(escape(cell) for cell in line))
    return table


def report_notes(report: Report) -> list[str]:
    """Notes that explain the tables, one line of plain text each."""
    manifest, settings = report.manifest, report.settings
    notes = [
        _what_was_evaluated(report),
        f"Truth [{manifest.truth}]: {manifest.ground_truth}.",
        f"Error: mean distance over 68 points (51: without the jaw) / {NORMALISERS[manifest.normaliser]} "
        f"[{manifest.normaliser}], in %. AUC and failures: threshold {100 * manifest.threshold:g} %.",
        f"Box of the crop: {manifest.box_rule}.",
        f"Row {settings.method}: {METHODS[settings.method]}. Row baseline: {BASELINE_RULE}.",
    ]
    if settings.method != "predictions":
        notes.append(f"Landmarks: {LANDMARK_TYPES[settings.landmark_type]} [{settings.landmark_type}].")
    if manifest.groups == "yaw":
        notes.insert(
            3, "Columns: |yaw| to 30°, above 30° to 60°, above 60°; mean of bins: their unweighted mean, the headline."
        )
    notes += [_failure_note(report), *_interval_notes(report), *_space_notes(report), *_pose_notes(report)]
    notes += detection_notes(report.detection)
    notes += _attribute_notes(report)
    if report.n_unusual_angles:
        notes.append(
            f"{counted(report.n_unusual_angles, 'image')} with an angle beyond ±99° in the truth: "
            "kept, in the bin of the |yaw| wrapped to 180°."
        )
    notes += [f"{key}: {value}" for key, value in report.subject.items() if isinstance(value, str)]
    return notes + _map_notes(report) + _lists(report)


def _what_was_evaluated(report: Report) -> str:
    manifest = report.manifest
    if manifest.kind != "clips":
        return f"Evaluated {len(report.results)} of {manifest.n_samples} images of {manifest.split}."
    n_clips = len({result.clip for result in report.results})
    return (
        f"Evaluated {counted(len(report.results), 'frame')} of {counted(n_clips, 'clip')}; {manifest.split} has "
        f"{manifest.n_samples} clips to test on."
    )


def _failure_note(report: Report) -> str:
    rule = "A face that was not found counts as an error above every threshold; means and medians are over those found"
    row = report.rows[0]
    if not row.all_images.n_failed:
        return f"{rule} (here all)."
    return (
        f"{rule}. Were the {row.all_images.n_failed} not found given the error of the baseline, the mean over "
        f"{report.manifest.what_is_counted}s would be {number(row.mean_failures_as_baseline)} % (68 points)."
    )


def _interval_notes(report: Report) -> list[str]:
    bootstrap = report.settings.bootstrap
    if not bootstrap.n_resamples:
        return []
    drawn = "clips (frames of one are not independent)" if report.results[:1] and report.results[0].clip else "images"
    if all(interval is None for interval in report.rows[0].intervals.values()):
        return [f"No intervals: expected at least two {drawn} to draw from."]
    return [f"Intervals: percentile bootstrap over {drawn}, {bootstrap.n_resamples} resamples, seed {bootstrap.seed}."]


def _space_notes(report: Report) -> list[str]:
    if not report.rows3d:
        return []
    alignment = report.settings.alignment
    unit = f"% of {report.unit3d}" if alignment == "depth" else "the data's unit"
    return [f"3D: distance in {unit}; landmarks compared [{alignment}] {ALIGNMENTS[alignment]}."]


def _pose_notes(report: Report) -> list[str]:
    if report.poses is None:
        return []
    n_left_out = len(report.results) - report.poses["all"].n_images
    return [
        "Pose: found minus true; positive pitch looks up, positive yaw turns to the picture's left, positive roll "
        "clockwise. MAE: mean absolute error. Rotation: mean angle between the found and the true head; near profiles "
        "pitch and roll turn about almost one axis, and say little apart. "
        f"Left out: {counted(n_left_out, 'image')} without a pose, with an angle beyond ±99°, or mirrored (negative "
        "scale)."
    ]


def _attribute_notes(report: Report) -> list[str]:
    if not report.by:
        return []
    names = ", ".join(own.attribute for own in report.by)
    return [f"By {names}: 68 points; numbers in quarters of the {report.manifest.what_is_counted}s, equal ones in one."]


def _map_notes(report: Report) -> list[str]:
    notes, maps, coefficients = [], report.maps, report.coefficients
    if maps is not None:
        notes.append(
            "Maps, means over images of the mean distance over the pixels of the crop that truth and prediction call "
            f"face: PNCC {number(maps.pncc_mm, 1, 1)} mm, offset {number(maps.offset_mm, 1, 1)} mm "
            f"(predicting no offset: {number(maps.offset_baseline_mm, 1, 1)} mm), mask IoU {maps.mask_iou:.3f}."
        )
    if coefficients is not None:
        notes.append(
            "Coefficients, RMS in standard deviations (saying zero in brackets), means over images: identity "
            f"{number(coefficients.identity_rms, 1)} ({number(coefficients.identity_baseline_rms, 1)}), expression "
            f"{number(coefficients.expression_rms, 1)} ({number(coefficients.expression_baseline_rms, 1)}); vertices "
            f"{coefficients.shape_mm:.2f} mm (mean face {coefficients.shape_baseline_mm:.2f} mm)."
        )
    return notes


def _lists(report: Report) -> list[str]:
    notes = []
    failed = [f"{result.name} ({result.failure})" for result in report.results if result.failure is not None]
    unreadable = [f"{face.name} ({face.reason})" for face in report.unreadable]
    for what, names in (("missing", list(report.missing)), ("unreadable", unreadable), ("not found", failed)):
        if names:
            more = len(names) - N_NAMES_SHOWN
            shown = ", ".join(names[:N_NAMES_SHOWN]) + (f" and {more} more (all in report.json)" if more > 0 else "")
            notes.append(f"{len(names)} {what}: {shown}.")
    return notes


def _line(row: ReportRow, *, with_groups: bool, is_binned: bool) -> list[str]:
    cells = [row.method, row.points]
    if with_groups:
        cells += [number(summary.mean) for summary in row.groups.values()]
    if is_binned:
        cells.append(number(row.mean_of_groups))
    summary: ErrorSummary = row.all_images
    cells += [number(summary.mean), number(summary.median)]
    cells += [number(value, digits=1) for value in (summary.area_under_curve, summary.failure_rate)]
    return [*cells, str(summary.n_failed)]
