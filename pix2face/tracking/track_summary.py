"""Summaries of a tracked clip: frames, jitter and identity of each face, for ``track.json`` and as text."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

from pix2face.command_line import counted
from pix2face.tracking.face_follower import LEAST_SEEN, FaceFollower
from pix2face.tracking.face_tracks import FrameBox, TrackSummary, read_boxes
from pix2face.tracking.track_files import BOX_SOURCES


@final
@dataclass(frozen=True, eq=False)
class ClipFace:
    """A face of the clip that is tracked."""

    folder: Path  # for its files
    tracks: Sequence[TrackSummary]  # the tracks that the face consists of
    frames: range  # frames in which it is tracked
    # Number of frames with each box source, and with each state of the fit ("fit carried"). The third pass counts them.
    counts: Counter[str] = field(default_factory=Counter)

    def detected(self, boxes: Path) -> Iterator[FrameBox]:
        """Reads the detections of the face from the file of all boxes."""
        return read_boxes(boxes, [own.track for own in self.tracks])

    @property
    def n_detected(self) -> int:
        """Number of frames with a detection."""
        return sum(own.n_detected for own in self.tracks)

    @property
    def n_written(self) -> int:
        """Number of frames written so far."""
        return sum(self.counts[name] for name in BOX_SOURCES)


def face_summary(face: ClipFace, follower: FaceFollower, out: Path) -> dict[str, object]:
    """Returns the entry of a face in ``track.json``."""
    return {
        "folder": str(face.folder.relative_to(out)),
        "first_frame": face.frames.start,
        "frames": face.n_written,
        **{f"frames_{name}": face.counts[name] for name in BOX_SOURCES},
        "frames_carried": face.counts["fit carried"],
        "frames_without_fit": face.counts["fit none"],
        "jitter_percent_raw": _percent(follower.jitter_raw.share),
        "jitter_percent_smoothed": _percent(follower.jitter_smoothed.share),
        "seen_share": None if follower.seen_share is None else round(follower.seen_share, 3),
        "identity": follower.identity.tolist(),
    }


def face_report(face: ClipFace, follower: FaceFollower, smoothing: str) -> list[str]:
    """Returns the summary of a face as text, with warnings if the network saw no face, or little of it."""
    raw, smoothed = _percent(follower.jitter_raw.share), _percent(follower.jitter_smoothed.share)
    jitter = "" if raw is None else f"; jitter {raw} % of the eye distance, {smoothed} % after {smoothing}"
    sources = ", ".join(f"{face.counts[name]} {name}" for name in BOX_SOURCES)
    lines = [f"{counted(face.n_written, 'frame')} ({sources}){jitter} -> {face.folder}"]
    if face.counts["fit carried"]:
        lines.append(
            f"warning: the network saw no face in {counted(face.counts['fit carried'], 'frame')}: the fit of the frame "
            "before was carried over (column fit: carried)"
        )
    if face.counts["fit none"]:
        lines.append(
            f"warning: {counted(face.counts['fit none'], 'frame')} without a face and without one shortly before: no "
            "landmarks there (column fit: none)"
        )
    if follower.seen_share is not None and follower.seen_share < LEAST_SEEN:
        lines.append(
            f"warning: {face.folder}: the network sees {100 * follower.seen_share:.0f} % of a face there; "
            "it is hidden, or there is none"
        )
    return lines


def _percent(share: float | None) -> float | None:
    return None if share is None else round(100 * share, 3)
