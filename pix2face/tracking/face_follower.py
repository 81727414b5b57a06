"""A face through a clip: detect, fill gaps, predict, fit with one identity, smooth.

Three passes over the frames, none of which keeps more than a few of them: boxes (written to a file as they come), the
identity (Eq. 5 over a bounded number of frames, spread over the clip), and the fits.

Source: Crispell and Bazik 2017, Section 4.2.

Deviation from the paper: which fits each frame alone. Here the identity is that of all frames together, so that only
camera and expression change from frame to frame.
"""

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal, TypeVar, final

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from pix2face.detectors.protocol import Box
from pix2face.fitting.coefficient_fit import JointAccumulator
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.crops import FaceBox
from pix2face.tracking import IDENTITY_FRAMES
from pix2face.tracking.clip_fit import FrameFitter, MeasuredFace, carried, eye_distance_px
from pix2face.tracking.face_tracks import FaceTracker, FrameBox
from pix2face.tracking.smoothing import JitterMeter, Smoother
from pix2face.tracking.video import PICTURES_FPS, FrameSource

Photograph = UInt8[ndarray, "_ _ 3"]
Advance = Callable[[], None]
Item = TypeVar("Item")

FitState = Literal["fitted", "carried", "none"]

# A fit is carried over so many seconds of frames without a face: an eye blink of the network, not a blank screen.
LONGEST_CARRIED_SECONDS = 0.5
# A face of which the network sees a smaller share is hidden, or there is none.
LEAST_SEEN = 0.45
# Faces that are in the network at a time.
FACES_AT_A_TIME = 8


@final
@dataclass(frozen=True, eq=False)
class TrackedFace:
    """One face in one frame."""

    box: FrameBox  # where it was looked for
    # Fitted to the maps; carried: they held no face, and the last fit was moved with the box; none: nor was there a fit
    # shortly before, and what stands in its place is of no frame.
    state: FitState
    fit: FaceFit  # before smoothing, pixels of the frame
    landmarks2d: Float64[ndarray, "m 2"]  # smoothed
    eye_px: float  # distance of the outer eye corners in 3D, at the scale of the frame
    seen_share: float | None = None  # how much of the face the network sees; None where it does not say

    @property
    def is_fitted(self) -> bool:
        """Whether the maps of this frame held a face."""
        return self.state == "fitted"


@final
@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """A frame with its faces, each under its place in the list of faces."""

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
    advance: Advance = lambda: None,
) -> int:
    """First pass: detects faces and tells the tracker.

    Args:
        source: The clip.
        find: From the number of a frame and the frame to the boxes of its faces; None where nobody has looked.
        tracker: Gets every detection.
        every: Look at every n-th frame only; boxes in between are interpolated.
        advance: Called after each frame.

    Returns:
        The number of frames.

    Raises:
        InputFileError: As ``FrameSource.frames``.
    """
    count = 0
    for index, image in enumerate(source.frames()):
        boxes = find(index, image) if index % every == 0 else None
        if boxes is not None:
            tracker.push(index, boxes)
        count = index + 1
        advance()
    return count


def find_identities(
    source: FrameSource,
    detected: Sequence[tuple[Iterable[FrameBox], int]],
    fitter: FrameFitter,
    *,
    at_most: int = IDENTITY_FRAMES,
    advance: Advance = lambda: None,
) -> list[Float64[ndarray, " k"]]:
    """Second pass: the identity of each face over the clip (Eq. 5), from frames in which it was detected.

    Args:
        source: The clip.
        detected: For each face its detections, in the order of frames, and their number.
        fitter: How frames are fitted.
        at_most: Frames for each face, evenly spread over its detections.
        advance: Called for each frame that is taken.

    Raises:
        DegenerateGeometryError: The network's output is not finite.
    """
    wanted: dict[int, list[tuple[int, FaceBox]]] = {}
    for face, (boxes, count) in enumerate(detected):
        for own in islice(boxes, 0, None, identity_step(count, at_most)):
            wanted.setdefault(own.frame, []).append((face, own.box))
    n_identity = fitter.model.n_identity
    identities: list[Float64[ndarray, " k"]] = [np.zeros(n_identity) for _ in detected]
    left = Counter(face for looks in wanted.values() for face, _ in looks)
    sums: dict[int, JointAccumulator] = {}  # of the faces in the picture: a long clip has many, each of megabytes
    last = max(wanted, default=-1)
    chosen = ((index, image) for index, image in enumerate(islice(source.frames(), last + 1)) if index in wanted)
    for chunk in _chunks(((face, image, box) for index, image in chosen for face, box in wanted[index])):
        measured = fitter.measure([(image, box) for _, image, box in chunk])
        for (face, _, _), seen in zip(chunk, measured, strict=True):
            if seen is not None:
                of_face = sums.setdefault(face, JointAccumulator(n_identity))
                of_face.add(seen.measurement.system, seen.measurement.regularisation)
            left[face] -= 1
            if face in sums and not left[face]:
                identities[face] = sums.pop(face).solve()[0]
            advance()
    for face, of_face in sums.items():  # a clip that ends before it did when it was searched
        identities[face] = of_face.solve()[0]
    return identities


def identity_step(n_detected: int, at_most: int) -> int:
    """The identity of a face comes from every n-th of its detections; this is n."""
    return max(1, -(-n_detected // at_most))


@final
class FaceFollower:
    """The last part of the chain for one face: fits with the identity, carries over gaps, smooths, measures jitter.

    Args:
        fitter: How frames are fitted.
        identity: Of the face, over the clip.
        smoother: Of its landmarks.
        fps: Frames a second.
    """

    def __init__(
        self, fitter: FrameFitter, identity: Float64[ndarray, " k"], smoother: Smoother, fps: float = PICTURES_FPS
    ) -> None:
        self.identity = identity
        self.jitter_raw, self.jitter_smoothed = JitterMeter(), JitterMeter()
        self._fitter, self._smoother = fitter, smoother
        self._waiting: deque[TrackedFace] = deque()
        self._longest_carried = LONGEST_CARRIED_SECONDS * fps
        self._last: TrackedFace | None = None  # the last that has a fit
        self._n_carried = 0  # in a row
        self._seen_shares: list[float] = []

    @property
    def seen_share(self) -> float | None:
        """How much of the face frames show, their median; None where the network does not say."""
        return float(np.median(self._seen_shares)) if self._seen_shares else None

    def push(self, box: FrameBox, measured: MeasuredFace | None) -> list[TrackedFace]:
        """Takes the next frame; gives back those that are smoothed by now."""
        seen_share = None if measured is None else measured.seen_share
        if seen_share is not None:
            self._seen_shares.append(seen_share)
        if box.source != "detected" and seen_share is not None and seen_share < LEAST_SEEN:
            measured = None  # neither detector nor network finds a face
        state = self._state(box, measured)
        is_cut = self._last is not None and (self._last.box.track != box.track or state == "none")
        done = self.flush() if is_cut else []
        fit = self._fit(box, measured)
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
        """The frames that are left; the next one begins a new sequence."""
        done = self._smoothed(self._smoother.flush())
        self.jitter_raw.cut()
        self.jitter_smoothed.cut()
        return done

    def _state(self, box: FrameBox, measured: MeasuredFace | None) -> FitState:
        if measured is not None:
            return "fitted"
        is_near = self._last is not None and self._last.box.track == box.track
        return "carried" if is_near and self._n_carried < self._longest_carried else "none"

    def _fit(self, box: FrameBox, measured: MeasuredFace | None) -> FaceFit:
        if measured is not None:
            return self._fitter.fit(measured, self.identity)
        if self._last is None or self._last.box.track != box.track:
            return self._fitter.placed(box.box, self.identity)
        return carried(self._last.fit, self._last.box.box, box.box)

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
    """Third pass: every frame in its order, with every face that is in it, fitted and smoothed.

    Keeps as many frames as the smoothers look ahead, and those that are in the network.

    Args:
        source: The clip.
        boxes: For each face its boxes, one a frame from some frame on, without gaps.
        followers: One for each face.
        fitter: How frames are fitted.

    Raises:
        DegenerateGeometryError: The network's output is not finite.
        InputFileError: As ``FrameSource.frames``.
    """
    ahead = [_Peekable(own) for own in boxes]
    waiting: deque[TrackedFrame] = deque()
    missing: dict[int, int] = {}  # faces that a waiting frame still lacks

    def take(face: int, done: Iterable[TrackedFace]) -> None:
        for own in done:
            waiting[own.box.frame - waiting[0].index].faces[face] = own
            missing[own.box.frame] -= 1

    def ready() -> Iterator[TrackedFrame]:
        while waiting and missing[waiting[0].index] == 0:
            del missing[waiting[0].index]
            yield waiting.popleft()

    for chunk in _chunks(enumerate(source.timed_frames())):
        looked_for = [
            (face, own.pop(), image)
            for index, (_, image) in chunk
            for face, own in enumerate(ahead)
            if own.frame == index
        ]
        for index, (time_s, image) in chunk:
            waiting.append(TrackedFrame(index, time_s, image, {}))
            missing[index] = sum(box.frame == index for _, box, _ in looked_for)
        measured = fitter.measure([(image, box.box) for _, box, image in looked_for])
        for (face, box, _), own in zip(looked_for, measured, strict=True):
            take(face, followers[face].push(box, own))
        for face in {face for face, _, _ in looked_for if ahead[face].frame is None}:
            take(face, followers[face].flush())
        yield from ready()


@final
class _Peekable:
    """Boxes of a face with a look at the frame of the next one (None after the last)."""

    def __init__(self, boxes: Iterator[FrameBox]) -> None:
        self._boxes = boxes
        self._next = next(boxes, None)

    @property
    def frame(self) -> int | None:
        return None if self._next is None else self._next.frame

    def pop(self) -> FrameBox:
        box = self._next
        assert box is not None
        self._next = next(self._boxes, None)
        return box


def _chunks(items: Iterable[Item]) -> Iterator[list[Item]]:
    """Lists of as many items as are looked at together."""
    iterator = iter(items)
    while chunk := list(islice(iterator, FACES_AT_A_TIME)):
        yield chunk
