"""Recall, false boxes and precision of detections that were counted by hand."""

from dataclasses import replace

import pytest

from pix2face.evaluation.figures.detection_summary import FaceDetection, is_of_face, summarise_detections
from pix2face.geometry.crops import FaceBox

TRUE_BOX = FaceBox(100, 100, 140, 150)
FOUND = FaceDetection(
    box=TRUE_BOX,
    score=2.0,
    overlap=0.8,
    n_false=0,
    candidates=((2.0, True),),
    true_size_px=50.0,
    detection_ms=4.0,
    whole_ms=10.0,
)
MISSED = replace(FOUND, box=None, score=None, overlap=None, n_false=2, candidates=((3.0, False), (1.0, False)))


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        (TRUE_BOX, True),
        (FaceBox(120, 100, 160, 150), True),  # the centre on the border
        (FaceBox(121, 100, 161, 150), False),
        (FaceBox(107.5, 112.5, 132.5, 137.5), True),  # half the size
        (FaceBox(108, 113, 132, 137), False),
        (FaceBox(70, 75, 170, 175), True),  # twice the size
        (FaceBox(69, 74, 171, 176), False),
    ],
)
def test_a_box_finds_a_face_by_its_centre_and_size(box: FaceBox, expected: bool) -> None:
    assert is_of_face(box, TRUE_BOX) is expected


def test_figures_are_those_counted_by_hand() -> None:
    second = replace(FOUND, overlap=0.6, true_size_px=20.0, candidates=((1.5, True), (0.5, False)), whole_ms=20.0)
    summary = summarise_detections([FOUND, None, MISSED, second], [5.0, 5.0, -70.0, 45.0])
    assert summary is not None
    assert (summary.all_faces.n_faces, summary.all_faces.n_found, summary.all_faces.recall) == (3, 2, 2 / 3)
    assert [(own.n_faces, own.n_found) for own in summary.by_yaw] == [(1, 1), (1, 1), (1, 0)]
    assert [(own.name, own.n_faces, own.n_found) for own in summary.by_size] == [
        ("16 to 32 px", 1, 1),
        ("32 to 64 px", 2, 1),
    ]
    assert (summary.n_false, summary.n_with_false, summary.false_per_photograph) == (2, 1, 2 / 3)
    assert summary.median_overlap == pytest.approx(0.7)
    assert summary.whole_ms == 10.0
    # Scores 3 (false), 2, 1.5 (right), 1, 0.5 (false).
    assert [score for score, _, _ in summary.curve] == [3.0, 2.0, 1.5, 1.0, 0.5]
    assert [recall for _, recall, _ in summary.curve] == pytest.approx([0, 1 / 3, 2 / 3, 2 / 3, 2 / 3])
    assert [precision for _, _, precision in summary.curve] == pytest.approx([0, 1 / 2, 2 / 3, 1 / 2, 2 / 5])
    assert summary.average_precision == pytest.approx(2 / 3 * 2 / 3)


def test_without_detections_there_is_no_summary_and_without_boxes_no_overlap() -> None:
    assert summarise_detections([None, None], [None, 3.0]) is None
    summary = summarise_detections([replace(MISSED, candidates=(), n_false=0)], [None])
    assert summary is not None
    assert (summary.median_overlap, summary.average_precision, summary.curve, summary.by_yaw) == (None, None, (), ())
    assert summary.by_size[0].recall == 0


def test_a_long_curve_is_thinned_and_keeps_its_ends() -> None:
    many = tuple((float(score), False) for score in range(5000, 0, -1))
    summary = summarise_detections([replace(MISSED, candidates=many)], [None])
    assert summary is not None
    assert len(summary.curve) <= 200
    assert (summary.curve[0][0], summary.curve[-1][0]) == (5000.0, 1.0)
