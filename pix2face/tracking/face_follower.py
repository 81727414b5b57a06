"""Tracks faces through a clip in three passes, each of which keeps only a few frames in memory.

The first pass detects boxes and writes them to a file. The second fits one identity to each face (Eq. 5, from a bounded
number of frames that are spread over the clip). The third fits and smooths every frame.

Source: Crispell and Bazik 2017, Section 4.2.

Deviation from the paper: the paper fits each frame alone. Here all frames share one identity, and only camera and
expression change from frame to frame.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, final

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from pix2face.detectors.protocol import Box
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.crops import FaceBox
from pix2face.tracking.ahead import ahead, in_chunks, mapped
from pix2face.tracking.clip_fit import FrameFitter, SettledFace, box_to_box, eye_distance_px
from pix2face.tracking.clip_identity import ClipIdentity
from pix2face.tracking.face_tracks import FaceTracker, FrameBox
from pix2face.tracking.smoothing import JitterMeter, Smoother
from pix2face.tracking.video import PICTURES_FPS, FrameSource

Photograph = UInt8[ndarray, "_ _ 3"]

FitState = Literal["fitted", "carried", "none"]

# For how long the last fit is used where the network finds no face.
LONGEST_CARRIED_SECONDS = 0.5
# If the network sees a smaller share of a face, the face is hidden, or there is none.
LEAST_SEEN = 0.45


@final
@dataclass(frozen=True, eq=False)
class TrackedFace:
    """One face in one frame."""

    box: FrameBox
    # fitted: fitted to the maps. carried: the maps showed no face, and the last fit was moved with the box. none: there
    # was no recent fit either; ``fit`` is then a placeholder.
    state: FitState
    fit: FaceFit  # before smoothing, pixels of the frame
    landmarks2d: Float64[ndarray, "m 2"]  # smoothed, pixels of the frame
    eye_px: float  # 3D distance of the outer eye corners at the camera's scale
    seen_share: float | None = None  # visible share of the face; None if the network does not predict it

    @property
    def is_fitted(self) -> bool:
        """Whether the maps of this frame show a face."""
        return self.state == "fitted"


@final
@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """A frame and its faces, by their index in the list of faces."""

    index: int
    time_s: float  # from the first frame
    image: Photograph
    faces: dict[int, TrackedFace]


def find_boxes(
    source: FrameSource,
    find: Callable[[int, Photograph], Sequence[Box] | None],
    tracker: FaceTracker,
    *,
    every: int = 1,
    advance: Callable[[], None] = lambda: None,
) -> int:
    """First pass: detects faces and passes them to the tracker.

    Args:
        source: The clip.
        find: Takes a frame's number and image, and returns the boxes of its faces, or None if they are unknown. Two
            threads call it.
        tracker: Receives every detection.
        every: Detect in every n-th frame only.
        advance: Called after each frame.

    Returns:
        The number of frames.

    Raises:
        InputFileError: As ``FrameSource.frames``.
    """

    def look(frame: tuple[int, Photograph]) -> tuple[int, Sequence[Box] | None]:
        index, image = frame
        return index, find(index, image) if index % every == 0 else None

    count = 0
    for index, boxes in mapped(look, enumerate(source.frames())):
        if boxes is not None:
            tracker.push(index, boxes)
        count = index + 1
        advance()
    return count


@final
class FaceFollower:
    """The third pass for one face: fills gaps between fits, smooths landmarks and measures jitter.

    Args:
        fitter: Fits the frames.
        found: The identity of the face, and the fits of the second pass.
        smoother: Smooths the landmarks.
        fps: Frames per second.
    """

    def __init__(self, fitter: FrameFitter, found: ClipIdentity, smoother: Smoother, fps: float = PICTURES_FPS) -> None:
        self.identity, self.known_fits = found.coefficients, found.fits
        self.jitter_raw, self.jitter_smoothed = JitterMeter(), JitterMeter()
        self._fitter, self._smoother = fitter, smoother
        self._waiting: deque[TrackedFace] = deque()
        self._longest_carried = LONGEST_CARRIED_SECONDS * fps
        self._last: TrackedFace | None = None  # the last with a fit
        self._n_carried = 0  # in a row
        self._seen_shares: list[float] = []

    @property
    def seen_share(self) -> float | None:
        """Median of the visible share of the face over the frames; None if the network does not predict it."""
        return float(np.median(self._seen_shares)) if self._seen_shares else None

    def push(self, box: FrameBox, settled: SettledFace | None) -> list[TrackedFace]:
        """Takes the next frame, and returns those that are now smoothed."""
        seen_share = None if settled is None else settled.seen_share
        if seen_share is not None:
            self._seen_shares.append(seen_share)
        if box.source != "detected" and seen_share is not None and seen_share < LEAST_SEEN:
            settled = None  # neither the detector nor the network finds a face
        state, fit = self._state_and_fit(box, settled)
        is_cut = self._last is not None and (self._last.box.track != box.track or state == "none")
        done = self.flush() if is_cut else []
        face = TrackedFace(box, state, fit, fit.landmarks2d, eye_distance_px(fit), seen_share)
        if state == "none":
            self._last = None
            return [*done, face]
        self._last = face
        self._n_carried = self._n_carried + 1 if state == "carried" else 0
        self.jitter_raw.push(face.landmarks2d, face.eye_px)
        self._waiting.append(face)
        return done + self._smoothed(self._smoother.push(face.landmarks2d, face.eye_px))

    def flush(self) -> list[TrackedFace]:
        """Returns the remaining frames. The next frame begins a new sequence."""
        done = self._smoothed(self._smoother.flush())
        self.jitter_raw.cut()
        self.jitter_smoothed.cut()
        return done

    def _state_and_fit(self, box: FrameBox, settled: SettledFace | None) -> tuple[FitState, FaceFit]:
        if settled is not None:
            return "fitted", settled.fit
        if self._last is None or self._last.box.track != box.track:
            return "none", self._fitter.placed(box.box, self.identity)
        moved = self._last.fit.transformed(box_to_box(self._last.box.box, box.box))
        return "carried" if self._n_carried < self._longest_carried else "none", moved

    def _smoothed(self, points: Sequence[Float64[ndarray, "_ 2"]]) -> list[TrackedFace]:
        done = []
        for landmarks2d in points:
            face = replace(self._waiting.popleft(), landmarks2d=landmarks2d)
            self.jitter_smoothed.push(landmarks2d, face.eye_px)
            done.append(face)
        return done


def follow_faces(
    source: FrameSource,
    boxes: Sequence[Iterator[FrameBox]],
    followers: Sequence[FaceFollower],
    fitter: FrameFitter,
) -> Iterator[TrackedFrame]:
    """Third pass: yields every frame in order, with the fitted and smoothed faces in it.

    While a chunk of frames is smoothed, threads process the next. A few chunks and the frames that the smoothers wait
    for are in memory.

    Args:
        source: The clip.
        boxes: Boxes of each face: one per frame, without gaps, from the face's first frame on.
        followers: One for each face.
        fitter: Fits the frames.

    Raises:
        DegenerateGeometryError: The network's output is not finite.
        InputFileError: As ``FrameSource.frames``.
    """
    waiting: deque[TrackedFrame] = deque()
    missing: dict[int, int] = {}  # number of faces that a waiting frame still lacks

    def take(face: int, done: Iterable[TrackedFace]) -> None:
        for own in done:
            waiting[own.box.frame - waiting[0].index].faces[face] = own
            missing[own.box.frame] -= 1

    def ready() -> Iterator[TrackedFrame]:
        while waiting and missing[waiting[0].index] == 0:
            del missing[waiting[0].index]
            yield waiting.popleft()

    for chunk, measured in ahead(fitter.measure_each(_chunks_of_clip(source, boxes, followers)), 1):
        for index, time_s, image in chunk.frames:
            waiting.append(TrackedFrame(index, time_s, image, {}))
            missing[index] = sum(box.frame == index for _, box in chunk.faces)
        new = iter(measured)
        for face, box in chunk.faces:
            settled = followers[face].known_fits.pop(box.frame, None)  # popped, since a fit may keep its mesh
            if settled is None and (seen := next(new)) is not None:
                settled = fitter.settled(seen, followers[face].identity)
            take(face, followers[face].push(box, settled))
        for face in chunk.ended:
            take(face, followers[face].flush())
        yield from ready()


@final
@dataclass(frozen=True, eq=False)
class _Chunk:
    """Consecutive frames."""

    frames: list[tuple[int, float, Photograph]]  # number, time in seconds, image
    faces: list[tuple[int, FrameBox]]  # every face in each of them
    ended: set[int]  # faces that are in no later chunk


def _chunks_of_clip(
    source: FrameSource, boxes: Sequence[Iterator[FrameBox]], followers: Sequence[FaceFollower]
) -> Iterator[tuple[_Chunk, list[tuple[Photograph, FaceBox]]]]:
    """Yields all frames in chunks, each with the faces that are not fitted yet."""
    upcoming = [next(own, None) for own in boxes]
    for frames in in_chunks((index, *timed) for index, timed in enumerate(source.timed_frames())):
        images = {index: image for index, _, image in frames}
        faces: list[tuple[int, FrameBox]] = []
        for index in images:
            for face, box in enumerate(upcoming):
                if box is not None and box.frame == index:
                    faces.append((face, box))
                    upcoming[face] = next(boxes[face], None)
        ended = {face for face, _ in faces if upcoming[face] is None}
        new = [(images[box.frame], box.box) for face, box in faces if box.frame not in followers[face].known_fits]
        yield _Chunk(frames, faces, ended), new
