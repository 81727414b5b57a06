"""Which boxes of which frames are of one face, and the box of a face in every frame.

Detections are matched to the faces of the frames before, one to one, and written to a file as they come; the faces are
then read back from it frame by frame. So memory does not grow with the length of the clip.

Source: Crispell and Bazik 2017, Section 4.2: "bounding box locations before and after the frame are used to determine
the correct location of the subject"; where none is found, "linearly interpolated from the two bounding boxes temporally
adjacent". Deviation from the paper: before the first and after the last detection the box is held.
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, replace
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

# A face is followed over a gap of so many seconds; after that, what appears is a new one.
LONGEST_GAP_SECONDS = 2.0
# A detection may be of a face that moved by so many box sides, and as many again for each second of gap.
REACH_IN_SIDES = 0.6
REACH_PER_SECOND = 0.6
LARGEST_RATIO_OF_SIZES = 1.7
# A face with fewer detections is taken for an accident of the detector, if another face has more.
LEAST_DETECTIONS = 3
# So is a face that a detector finds in a smaller share of its frames. Boxes from a file may name few frames.
LEAST_SHARE_DETECTED = 0.25


@final
@dataclass(frozen=True)
class TrackSummary:
    """One face over the clip."""

    track: int  # its number
    first: int  # frame of its first detection
    last: int  # frame of its last detection
    n_detected: int  # in how many frames it was found
    weight: float  # sum of its box sides over these frames: how much of the clip it fills


@final
@dataclass(frozen=True)
class FrameBox:
    """The box of a face in one frame."""

    frame: int  # number, from 0
    box: FaceBox  # pixels of the frame
    source: BoxSource  # held: before the first detection, after the last, or across a change of track
    track: int  # it changes where the clip does
    score: float | None = None  # of a detected box; None where it was given, interpolated or held


@final
class FaceTracker:
    """Matches detections to faces frame by frame, and writes them down.

    Args:
        file: Open for writing text; gets one line a detection (``frame,track,left,top,right,bottom,score``).
        fps: Frames a second.
    """

    def __init__(self, file: TextIOBase | GrowingFile, fps: float) -> None:
        self._rows = csv.writer(file, lineterminator="\n")
        self._rows.writerow(BOX_COLUMNS)
        self._fps = fps
        self._tracks: list[TrackSummary] = []
        self._live: dict[int, FaceBox] = {}
        self._before = 0  # the frame that was looked at before

    @property
    def tracks(self) -> tuple[TrackSummary, ...]:
        """The faces so far."""
        return tuple(self._tracks)

    def push(self, frame: int, faces: Sequence[Box]) -> None:
        """Takes the detections of a frame; frames come in their order, and may be left out."""
        found = [box_and_score(face) for face in faces]
        # A face of the frame that was looked at before is not lost, however long ago that was.
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
            sides = (f"{side:.3f}" for side in astuple(box))
            self._rows.writerow([frame, track, *sides, "" if score is None else f"{score:.4g}"])

    def _match(self, frame: int, boxes: Sequence[FaceBox]) -> dict[int, int]:
        """The face of each box that is near to one: the assignment with the least sum of distances."""
        live = list(self._live)
        if not live or not boxes:
            return {}
        costs = np.array([[self._cost(frame, track, box) for track in live] for box in boxes])
        rows, columns = linear_sum_assignment(np.where(np.isfinite(costs), costs, 1e6))
        return {
            int(row): live[column] for row, column in zip(rows, columns, strict=True) if np.isfinite(costs[row, column])
        }

    def _cost(self, frame: int, track: int, box: FaceBox) -> float:
        """How unlike the last box of a face a box is; infinite where it cannot be of the same."""
        last = self._live[track]
        seconds = (frame - self._tracks[track].last) / self._fps
        side = (last.longer_side + box.longer_side) / 2
        distance = float(np.linalg.norm(box.centre - last.centre)) / side
        ratio = max(box.longer_side / last.longer_side, last.longer_side / box.longer_side)
        if distance > REACH_IN_SIDES + REACH_PER_SECOND * seconds or ratio > LARGEST_RATIO_OF_SIZES:
            return np.inf
        return distance + float(np.log(ratio)) + 1 - overlap(last, box)


def lasting_faces(tracks: Iterable[TrackSummary], least_share: float = 0.0) -> list[TrackSummary]:
    """The faces with enough detections to be none of the detector's accidents, largest first.

    ``least_share`` is the share of its frames in which a face must have been found.
    """
    ordered = sorted(tracks, key=lambda own: -own.weight)
    lasting = [
        own for own in ordered if own.n_detected >= max(LEAST_DETECTIONS, least_share * (own.last - own.first + 1))
    ]
    return lasting or ordered[:1]


def main_face(tracks: Iterable[TrackSummary], least_share: float = 0.0) -> list[TrackSummary]:
    """The tracks that make up the main face of a clip, in the order of time; none where there is no track.

    The face that fills most of the clip, and in the frames before and after it that which fills most of them: a face
    that was lost for long and found again elsewhere has several tracks.
    """
    chosen: list[TrackSummary] = []
    for own in lasting_faces(tracks, least_share):
        if all(own.last < other.first or own.first > other.last for other in chosen):
            chosen.append(own)
    return sorted(chosen, key=lambda own: own.first)


def read_boxes(path: Path, tracks: Iterable[int]) -> Iterator[FrameBox]:
    """The detections of some tracks out of what ``FaceTracker`` has written, in the order of frames."""
    wanted = set(tracks)
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if int(row["track"]) in wanted:
                box = FaceBox(*(float(row[side]) for side in ("left", "top", "right", "bottom")))
                score = float(row["score"]) if row["score"] else None
                yield FrameBox(int(row["frame"]), box, "detected", int(row["track"]), score)


def boxes_of_every_frame(detected: Iterable[FrameBox], frames: range) -> Iterator[FrameBox]:
    """The box in each frame of a range.

    Between two detections of one track the box is interpolated; before the first, after the last, and between two
    tracks the nearest detection is held. Detections come in the order of frames; there is at least one.
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
    sides = (1 - share) * np.array(astuple(before.box)) + share * np.array(astuple(after.box))
    return FrameBox(frame, FaceBox(*sides.tolist()), "interpolated", before.track)
