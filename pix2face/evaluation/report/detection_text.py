"""How well a detector found the faces of a benchmark, as text."""

from pix2face.command_line import counted
from pix2face.evaluation.figures.detection_summary import DetectionSummary
from pix2face.evaluation.report.table_text import SHORT_GROUPS, ReportTable, number


def detection_table(own: DetectionSummary | None) -> ReportTable | None:
    """Recall in bins of yaw and of size; None without a detector."""
    if own is None:
        return None
    bins = [
        ("all", own.all_faces),
        *(("|yaw|", each) for each in own.by_yaw),
        *(("size", each) for each in own.by_size),
    ]
    lines = [
        [
            each.name if what == "all" else f"{what} {SHORT_GROUPS.get(each.name, each.name)}",
            str(each.n_faces),
            str(each.n_found),
            number(each.recall, digits=1),
        ]
        for what, each in bins
    ]
    caption = "Faces that the detector found, by |yaw| and by the longer side of the true box in pixels."
    return ReportTable(caption, ["detection", "faces", "found", "recall, %"], lines)


def detection_notes(own: DetectionSummary | None) -> list[str]:
    """False boxes, overlap, precision and time, one line each; none without a detector."""
    if own is None:
        return []
    return [
        f"Detection: {own.n_false} false boxes, {own.false_per_photograph:.3f} a photograph, in "
        f"{counted(own.n_with_false, 'photograph')}. Each box that is not the one of the annotated face is false, also "
        "one of somebody who is not annotated.",
        f"Overlap of the boxes with the true ones (intersection over union), of the faces found: median "
        f"{number(own.median_overlap, 1)}, lowest tenth {number(own.lowest_tenth_overlap, 1)}.",
        f"Average precision {number(own.average_precision, 1, 3)}: area under precision over recall of all candidates "
        "of the detector, before refinement.",
        f"Time a photograph, median: detector {own.detection_ms:.1f} ms, with refinement {own.whole_ms:.1f} ms.",
    ]
