"""Assigns detections to faces over a clip, and computes the box of a face in every frame.

Detections are matched one to one with the faces of earlier frames and written to a file. They are later read back frame
by frame, so that memory does not grow with the length of the clip.

Source: Crispell and Bazik 2017, Section 4.2: "bounding box locations before and after the frame are used to determine
the correct location of the subject"; where none is found, "linearly interpolated from the two bounding boxes temporally
adjacent". Deviation from the paper: before the first and after the last detection, that detection's box is used.
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from io import TextIOBase
from pathlib import Path
from typing import Literal, final

import numpy as np
from scipy.optimize import linear_sum_assignment

from pix2face.detectors.protocol import Box, box_and_score, overlap
from pix2face.files.writing import GrowingFile
from pix2face.geometry.crops import FaceBox

BoxSource = Literal["detected", "interpolated", "held"]

BOX_COLUMNS = ("frame", "track", "left", "top", "right", "bottom", "score")

# After a longer gap without detections, a detection starts a new track.
LONGEST_GAP_SECONDS = 2.0
# Largest distance between two detections of a face, in box sides: a constant, and a rate for the time between them.
REACH_IN_SIDES = 0.6
REACH_PER_SECOND = 0.6
LARGEST_RATIO_OF_SIZES = 1.7
# A track with fewer detections counts as a false detection if another track has at least as many.
LEAST_DETECTIONS = 3
# So does a track with detections in a smaller share of its frames. It is not used for boxes from a file, which may name
# few frames.
LEAST_SHARE_DETECTED = 0.25


@final
@dataclass(frozen=True)
class TrackSummary:
    """Detections that follow one face without a long gap."""

    track: int  # number of the track
    first: int  # frame of the first detection
    last: int  # frame of the last detection
    n_detected: int  # number of frames with a detection
    weight: float  # sum of the longer box sides over these frames


@final
@dataclass(frozen=True)
class FrameBox:
    """The box of a face in one frame."""

    frame: int  # number, from 0
    box: FaceBox  # pixels of the frame
    source: BoxSource  # held: the nearest detection, before the first, after the last, or between two tracks
    track: int  # number of the track
    score: float | None = None  # of a detected box; None if it was given, interpolated or held


@final
class FaceTracker:
    """Matches detections with tracks, frame by frame, and writes them to a file.

    Args:
        file: File open for writing text. Each detection is one line: ``frame,track,left,top,right,bottom,score``.
        fps: Frames per second.
    """

    def __init__(self, file: TextIOBase | GrowingFile, fps: float) -> None:
        self._rows = csv.writer(file, lineterminator="\n")
        self._rows.writerow(BOX_COLUMNS)
        self._fps = fps
        self._tracks: list[TrackSummary] = []
        self._live: dict[int, FaceBox] = {}
        self._before = 0  # number of the last frame pushed

    @property
    def tracks(self) -> tuple[TrackSummary, ...]:
        """The tracks so far."""
        return tuple(self._tracks)

    def push(self, frame: int, faces: Sequence[Box]) -> None:
        """Takes the detections of a frame. Frames must be in order, and some may be left out."""
        found = [box_and_score(face) for face in faces]
        # Tracks of the last frame pushed are kept, however long ago it was.
        gap = max(LONGEST_GAP_SECONDS * self._fps, frame - self._before)
        self._live = {track: box for track, box in self._live.items() if frame - self._tracks[track].last <= gap}
        self._before = frame
        matched = self._match(frame, [box for box, _ in found])
        for index, (box, score) in enumerate(found):
            track = matched.get(index)
            if track is None:
                track = len(self._tracks)
                self._tracks.append(TrackSummary(track, frame, frame, 0, 0.0))
            before = self._tracks[track]
            self._tracks[track] = replace(
                before, last=frame, n_detected=before.n_detected + 1, weight=before.weight + box.longer_side
            )
            self._live[track] = box
            sides = (f"{side:.3f}" for side in box.sides)
            self._rows.writerow([frame, track, *sides, "" if score is None else f"{score:.4g}"])

    def _match(self, frame: int, boxes: Sequence[FaceBox]) -> dict[int, int]:
        """Assigns tracks to boxes with the smallest sum of costs. Boxes that match no track are left out."""
        live = list(self._live)
        if not live or not boxes:
            return {}
        costs = np.array([[self._cost(frame, track, box) for track in live] for box in boxes])
        rows, columns = linear_sum_assignment(np.where(np.isfinite(costs), costs, 1e6))
        return {
            int(row): live[column] for row, column in zip(rows, columns, strict=True) if np.isfinite(costs[row, column])
        }

    def _cost(self, frame: int, track: int, box: FaceBox) -> float:
        """Returns the cost of assigning a box to a track; infinite if it cannot be the same face."""
        last = self._live[track]
        seconds = (frame - self._tracks[track].last) / self._fps
        side = (last.longer_side + box.longer_side) / 2
        distance = float(np.linalg.norm(box.centre - last.centre)) / side
        ratio = max(box.longer_side / last.longer_side, last.longer_side / box.longer_side)
        if distance > REACH_IN_SIDES + REACH_PER_SECOND * seconds or ratio > LARGEST_RATIO_OF_SIZES:
            return np.inf
        return distance + float(np.log(ratio)) + 1 - overlap(last, box)


def lasting_faces(tracks: Iterable[TrackSummary], least_share: float = 0.0) -> list[TrackSummary]:
    """Returns the tracks that are no false detections, by decreasing weight; at least one if there is any.

    Args:
        tracks: All tracks of a clip.
        least_share: Smallest share of a track's frames that must have a detection.
    """
    ordered = sorted(tracks, key=lambda own: -own.weight)
    lasting = [
        own for own in ordered if own.n_detected >= max(LEAST_DETECTIONS, least_share * (own.last - own.first + 1))
    ]
    return lasting or ordered[:1]


def main_face(tracks: Iterable[TrackSummary], least_share: float = 0.0) -> list[TrackSummary]:
    """Returns the tracks of the main face of a clip, in the order of time; empty if there is no track.

    These are the track with the largest weight and, in the frames before and after it, the largest tracks that do not
    overlap: a face that was lost for long and then found again has several tracks.
    """
    chosen: list[TrackSummary] = []
    for own in lasting_faces(tracks, least_share):
        if all(own.last < other.first or own.first > other.last for other in chosen):
            chosen.append(own)
    return sorted(chosen, key=lambda own: own.first)


def read_boxes(path: Path, tracks: Iterable[int]) -> Iterator[FrameBox]:
    """Yields the detections of some tracks from a file that ``FaceTracker`` wrote, in the order of frames."""
    wanted = set(tracks)
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if int(row["track"]) in wanted:
                box = FaceBox(*(float(row[side]) for side in ("left", "top", "right", "bottom")))
                score = float(row["score"]) if row["score"] else None
                yield FrameBox(int(row["frame"]), box, "detected", int(row["track"]), score)


def boxes_of_every_frame(detected: Iterable[FrameBox], frames: range) -> Iterator[FrameBox]:
    """Yields the box in each frame of a range, from at least one detection, in the order of frames.

    The box is interpolated between two detections of one track. Before the first, after the last, and between two
    tracks, it is that of the nearest detection.
    """
    start, before = frames.start, None
    for after in detected:
        for frame in range(start, min(after.frame, frames.stop)):
            yield _between(before or after, after, frame)
        start, before = max(start, after.frame), after
    if before is not None:
        for frame in range(start, frames.stop):
            yield _between(before, before, frame)


def _between(before: FrameBox, after: FrameBox, frame: int) -> FrameBox:
    if frame == before.frame:
        return before
    if not before.frame < frame < after.frame or before.track != after.track:
        nearest = after if abs(after.frame - frame) < abs(frame - before.frame) else before
        return FrameBox(frame, nearest.box, "held", nearest.track)
    share = (frame - before.frame) / (after.frame - before.frame)
    sides = (1 - share) * np.array(before.box.sides) + share * np.array(after.box.sides)
    return FrameBox(frame, FaceBox(*sides.tolist()), "interpolated", before.track)
