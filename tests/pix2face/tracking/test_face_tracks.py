"""Detections become faces, and a face has a box in every frame."""

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.face_files.box_files import read_box_file
from pix2face.geometry.crops import FaceBox
from pix2face.tracking.face_tracks import (
    FaceTracker,
    FrameBox,
    TrackSummary,
    boxes_of_every_frame,
    lasting_faces,
    main_face,
    read_boxes,
)

FPS = 10.0


def box(x: float, y: float = 0.0, side: float = 20.0) -> FaceBox:
    return FaceBox(x, y, x + side, y + side)


def tracked(frames: dict[int, list[FaceBox]]) -> tuple[FaceTracker, str]:
    file = io.StringIO()
    tracker = FaceTracker(file, FPS)
    for frame, boxes in frames.items():
        tracker.push(frame, boxes)
    return tracker, file.getvalue()


def seen(frame: int, x: float, track: int = 0) -> FrameBox:
    return FrameBox(frame, box(x), "detected", track)


def test_two_faces_keep_their_numbers_whatever_the_order_of_detections():
    frames = {index: [box(3.0 * index), box(200 - 3.0 * index, 40)][:: 1 if index % 2 else -1] for index in range(20)}
    tracker, text = tracked(frames)
    assert [own.n_detected for own in tracker.tracks] == [20, 20]
    rows = [line.split(",") for line in text.splitlines()[1:]]
    tops = {track: {row[3] for row in rows if row[1] == track} for track in ("0", "1")}
    assert all(len(own) == 1 for own in tops.values())  # each stays at its own height


def test_a_false_box_beside_does_not_take_the_face_over():
    frames = {index: [box(2.0 * index)] + ([box(90, 90)] if index % 3 == 0 else []) for index in range(12)}
    tracker, _ = tracked(frames)
    assert tracker.tracks[0].n_detected == 12


def test_a_face_is_followed_over_a_short_gap_but_not_over_a_long_one():
    short, _ = tracked({0: [box(0)], 15: [box(5)]})
    assert [own.n_detected for own in short.tracks] == [2]
    long, _ = tracked({0: [box(0)], 12: [], 25: [box(5)]})
    assert [own.n_detected for own in long.tracks] == [1, 1]


def test_a_face_is_followed_however_seldom_frames_are_looked_at():
    seldom, _ = tracked({frame: [box(frame / 10)] for frame in range(0, 500, 50)})  # each 5 s, a gap of 2 s allowed
    assert [own.n_detected for own in seldom.tracks] == [10]
    lost, _ = tracked({frame: [box(0)] if frame in (0, 150) else [] for frame in range(0, 500, 50)})
    assert [own.n_detected for own in lost.tracks] == [1, 1]


def test_a_box_far_off_or_of_another_size_is_another_face():
    tracker, _ = tracked({0: [box(0)], 1: [box(100)], 2: [box(0, 0, 60)]})
    assert len(tracker.tracks) == 3


def test_what_is_written_is_read_back_by_track_and_as_a_box_file(tmp_path):
    _, text = tracked({0: [box(0), box(100)], 2: [box(1), box(101)]})
    path = Path(tmp_path / "boxes.csv")
    path.write_text(text)
    assert [(own.frame, own.box.left, own.track) for own in read_boxes(path, [1])] == [(0, 100, 1), (2, 101, 1)]
    assert read_box_file(path).of_frame(2) == (box(1), box(101))


def test_gaps_are_interpolated_and_ends_held():
    boxes = list(boxes_of_every_frame([seen(2, 2), seen(5, 8)], range(8)))
    assert [own.frame for own in boxes] == list(range(8))
    assert [own.box.left for own in boxes] == [2, 2, 2, 4, 6, 8, 8, 8]
    assert [own.source[0] for own in boxes] == list("hhdiidhh")


def test_between_two_tracks_the_nearer_box_is_held():
    boxes = list(boxes_of_every_frame([seen(0, 0, 0), seen(5, 90, 1)], range(6)))
    assert [own.box.left for own in boxes] == [0, 0, 0, 90, 90, 90]
    assert [own.track for own in boxes] == [0, 0, 0, 1, 1, 1]
    assert [own.source[0] for own in boxes] == list("dhhhhd")


@given(st.sets(st.integers(0, 30), min_size=1), st.integers(0, 10), st.integers(1, 40))
def test_every_frame_of_the_range_has_one_box(frames, start, length):
    detected = [seen(frame, float(frame)) for frame in sorted(frames)]
    boxes = list(boxes_of_every_frame(detected, range(start, start + length)))
    assert [own.frame for own in boxes] == list(range(start, start + length))
    for own in boxes:
        assert (own.source == "detected") == (own.frame in frames)
        nearest = np.clip(own.frame, min(frames), max(frames))
        assert own.box.left == pytest.approx(nearest)  # the detections lie on a line


def test_one_look_ahead_is_enough():
    def endless():
        for frame in range(1_000_000):
            assert frame < 50
            yield seen(frame, 0.0)

    boxes = boxes_of_every_frame(endless(), range(1_000_000))
    for _ in range(40):
        next(boxes)


def summary(track: int, first: int, last: int, n: int, weight: float) -> TrackSummary:
    return TrackSummary(track, first, last, n, weight)


def test_the_main_face_fills_most_of_the_clip_and_is_found_again_elsewhere():
    tracks = [
        summary(0, 0, 40, 41, 400),
        summary(1, 0, 99, 100, 300),
        summary(2, 60, 99, 40, 350),
        summary(3, 45, 50, 2, 900),
    ]
    assert [own.track for own in main_face(tracks)] == [0, 2]
    assert [own.track for own in lasting_faces(tracks)] == [0, 2, 1]
    assert main_face([]) == []


def test_a_face_that_is_seldom_found_is_an_accident_unless_there_is_no_other():
    tracks = [summary(0, 0, 99, 10, 900), summary(1, 0, 99, 60, 600), summary(2, 50, 52, 3, 60)]
    assert [own.track for own in lasting_faces(tracks, 0.25)] == [1, 2]
    assert [own.track for own in main_face(tracks, 0.25)] == [1]
    assert [own.track for own in lasting_faces(tracks[:1], 0.25)] == [0]


def test_a_clip_of_one_frame_has_a_face():
    tracker, _ = tracked({0: [box(0, 0, 30), box(100)]})
    assert [own.track for own in main_face(tracker.tracks)] == [0]
