"""Fits one identity to each face of a clip, from a bounded number of frames (Eq. 5)."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.fitting.least_squares.linear_system import JointAccumulator
from pix2face.geometry.crops import FaceBox
from pix2face.tracking import IDENTITY_FRAMES
from pix2face.tracking.ahead import in_chunks
from pix2face.tracking.clip_fit import FaceView, FrameFitter, MeasuredFace, SettledFace
from pix2face.tracking.face_tracks import FrameBox
from pix2face.tracking.video import FrameSource


@final
@dataclass(frozen=True, eq=False)
class ClipIdentity:
    """The identity of a face, and the fits of the frames that it was computed from."""

    coefficients: Float64[ndarray, " k"]  # standard deviations
    fits: dict[int, SettledFace]  # by frame number


def find_identities(
    source: FrameSource,
    detected: Sequence[tuple[Iterable[FrameBox], int]],
    fitter: FrameFitter,
    *,
    at_most: int = IDENTITY_FRAMES,
    advance: Callable[[], None] = lambda: None,
) -> list[ClipIdentity]:
    """Second pass: fits one identity to each face (Eq. 5), from frames in which it was detected.

    Args:
        source: The clip.
        detected: Detections of each face, in the order of frames, and their number.
        fitter: Fits the frames.
        at_most: Largest number of frames for each face. They are evenly spread over its detections.
        advance: Called after each face of each frame used.

    Raises:
        DegenerateGeometryError: The network's output is not finite.
    """
    wanted: dict[int, list[tuple[int, FaceBox]]] = {}
    for face, (boxes, count) in enumerate(detected):
        for own in islice(boxes, 0, None, identity_step(count, at_most)):
            wanted.setdefault(own.frame, []).append((face, own.box))
    last = max(wanted, default=-1)
    chosen = ((index, image) for index, image in enumerate(islice(source.frames(), last + 1)) if index in wanted)
    looks = ((face, index, image, box) for index, image in chosen for face, box in wanted[index])
    groups = (([own[:2] for own in chunk], [own[2:] for own in chunk]) for chunk in in_chunks(looks))
    found = [ClipIdentity(np.zeros(fitter.model.n_identity), {}) for _ in detected]
    left = Counter(face for faces in wanted.values() for face, _ in faces)
    sums: dict[int, _IdentitySum] = {}  # only of faces with frames still to come, since each takes megabytes
    for places, measured in fitter.measure_each(groups):
        for (face, frame), seen in zip(places, measured, strict=True):
            if seen is not None:
                sums.setdefault(face, _IdentitySum(fitter)).add(frame, seen)
            left[face] -= 1
            if face in sums and not left[face]:
                found[face] = sums.pop(face).solve()
            advance()
    for face, of_face in sums.items():  # if the clip ends earlier than in the first pass
        found[face] = of_face.solve()
    return found


@final
class _IdentitySum:
    """Accumulates Eq. 5 over the frames of a face."""

    def __init__(self, fitter: FrameFitter) -> None:
        self._fitter = fitter
        self._systems = JointAccumulator(fitter.model.n_identity)
        self._views: list[tuple[int, FaceView]] = []

    def add(self, frame: int, seen: MeasuredFace) -> None:
        self._systems.add(seen.measurement.system, seen.measurement.regularisation)
        self._views.append((frame, seen.view))

    def solve(self) -> ClipIdentity:
        identity, expressions = self._systems.solve()
        fits = {
            frame: self._fitter.fit(view, identity, expression)
            for (frame, view), expression in zip(self._views, expressions, strict=True)
        }
        return ClipIdentity(identity, fits)


def identity_step(n_detected: int, at_most: int) -> int:
    """Returns n such that every n-th of a face's detections gives at most ``at_most`` frames."""
    return max(1, -(-n_detected // at_most))
