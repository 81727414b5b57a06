"""Smoothing of landmarks over the frames of a clip, and what is left of their jitter.

Every smoother takes frames one by one and gives each back after a bounded number of further ones, so that clips of any
length stream through. Which one to choose: docs/explanation/detection_and_tracking.md has their jitter, lag and
delay, measured.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache
from typing import Final, final, get_args

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.tracking import Smoothing

SMOOTHINGS: Final[tuple[Smoothing, ...]] = get_args(Smoothing)

# The smoothing spline penalises the square of the second difference by this much: half the height of a swing of 6
# frames passes, and three quarters of one of 8.
SPLINE_PENALTY = 1.0
# Frames on either side that it looks at; its weights have fallen below 1e-3 there.
SPLINE_REACH = 12

# One-Euro: at rest a low-pass of this many Hz, opened by so many Hz for each eye distance that a landmark moves in a
# second; the speed itself is smoothed by a low-pass of SPEED_CUTOFF_HZ.
REST_CUTOFF_HZ = 2.0
CUTOFF_PER_SPEED = 8.0
SPEED_CUTOFF_HZ = 1.0


class Smoother(ABC):
    """Smooths a sequence of point sets of one shape."""

    delay: int  # frames that have to follow before a frame is given back

    @abstractmethod
    def push(self, points: Float[ndarray, "n d"], unit: float) -> list[Float64[ndarray, "n d"]]:
        """Takes the next frame, and returns those that are done by now, in their order.

        The points may be in any unit; ``unit`` is the size of the face (its eye distance) in it.
        """

    @abstractmethod
    def flush(self) -> list[Float64[ndarray, "n d"]]:
        """The frames that are left; the next frame begins a new sequence."""


@final
class WindowSmoother(Smoother):
    """A weighted mean over a window around each frame; towards the ends of the sequence the window shrinks.

    Args:
        reach: Frames on either side.
        weights: From the numbers of frames before and after that are there (at most the reach) to the weight of each
            frame of the window, 1 in sum.
    """

    def __init__(self, reach: int, weights: Callable[[int, int], Float64[ndarray, " w"]]) -> None:
        self.delay = reach
        self._weights = weights
        self._window: list[Float64[ndarray, "n d"]] = []
        self._next = 0  # which of the window is to be given back next

    def push(self, points: Float[ndarray, "n d"], unit: float) -> list[Float64[ndarray, "n d"]]:
        """See the base class; the unit makes no difference to a weighted mean."""
        self._window.append(points.astype(np.float64))
        return [self._pop()] if len(self._window) - self._next > self.delay else []

    def flush(self) -> list[Float64[ndarray, "n d"]]:
        """See the base class."""
        done = [self._pop() for _ in range(len(self._window) - self._next)]
        self._window, self._next = [], 0
        return done

    def _pop(self) -> Float64[ndarray, "n d"]:
        weights = self._weights(self._next, min(len(self._window) - 1 - self._next, self.delay))
        smoothed = np.tensordot(weights, np.stack(self._window[: len(weights)]), axes=1)
        if self._next == self.delay:
            self._window.pop(0)
        else:
            self._next += 1
        return np.asarray(smoothed, dtype=np.float64)


@final
class OneEuroSmoother(Smoother):
    """A low-pass for each landmark whose cut-off rises with the landmark's speed; it looks at no frame ahead.

    Source: Casiez, Roussel and Vogel 2012, 1€ Filter. Here speed is that of a landmark (not of a coordinate), in eye
    distances a second, so that the setting serves faces of any size.

    Args:
        fps: Frames a second.
    """

    delay = 0

    def __init__(self, fps: float) -> None:
        self._seconds = 1 / fps
        # Points smoothed, points as they came, and their velocity.
        self._before: tuple[ndarray, ndarray, ndarray] | None = None

    def push(self, points: Float[ndarray, "n d"], unit: float) -> list[Float64[ndarray, "n d"]]:
        """See the base class."""
        raw = points.astype(np.float64)
        if self._before is None:
            smoothed, velocity = raw, np.zeros_like(raw)
        else:
            smoothed, last_raw, velocity = self._before
            change = (raw - last_raw) / (unit * self._seconds) - velocity
            velocity = velocity + _share(np.array(SPEED_CUTOFF_HZ), self._seconds) * change
            speed = np.linalg.norm(velocity, axis=1, keepdims=True)
            share = _share(REST_CUTOFF_HZ + CUTOFF_PER_SPEED * speed, self._seconds)
            smoothed = smoothed + share * (raw - smoothed)
        self._before = smoothed, raw, velocity
        return [smoothed]

    def flush(self) -> list[Float64[ndarray, "n d"]]:
        """See the base class."""
        self._before = None
        return []


@final
class JitterMeter:
    """The mean second difference of landmarks over the frames, as a share of the eye distance; in constant memory."""

    def __init__(self) -> None:
        self._last: list[Float64[ndarray, "n d"]] = []
        self._total, self._count = 0.0, 0

    def push(self, points: Float[ndarray, "n d"], unit: float) -> None:
        """Takes the next frame; ``unit`` is the eye distance."""
        self._last = [*self._last[-2:], points.astype(np.float64)]
        if len(self._last) == 3:
            before, now, after = self._last
            self._total += float(np.linalg.norm(before - 2 * now + after, axis=1).mean()) / unit
            self._count += 1

    def cut(self) -> None:
        """The next frame does not follow the last one."""
        self._last = []

    @property
    def share(self) -> float | None:
        """Mean over landmarks and frames; None where there were not three frames in a row."""
        return self._total / self._count if self._count else None


def open_smoother(kind: str, fps: float) -> Smoother:
    """A smoother by its name.

    "mean3" is the mean of three frames (the paper's), "one-euro" looks at no frame ahead, and "spline" is a smoothing
    spline over 12 frames on either side.

    Raises:
        UsageError: There is none of this name.
    """
    if kind == "none":
        return WindowSmoother(0, lambda before, after: np.ones(1))
    if kind == "mean3":
        return WindowSmoother(1, _mean3_weights)
    if kind == "one-euro":
        return OneEuroSmoother(fps)
    if kind == "spline":
        return WindowSmoother(SPLINE_REACH, _spline_weights)
    raise UsageError(f"expected a smoothing of {', '.join(SMOOTHINGS)}, found {kind!r}")


def _mean3_weights(before: int, after: int) -> Float64[ndarray, " w"]:
    """A third each; the first and the last frame stay as they are, a mean of two would drag them along."""
    if before and after:
        return np.full(3, 1 / 3)
    weights = np.zeros(before + 1 + after)
    weights[before] = 1
    return weights


@cache
def _spline_weights(before: int, after: int) -> Float64[ndarray, " w"]:
    """The row of (I + lambda D'D)^-1 for the frame, D the second differences over the window.

    Source: Reinsch 1967, Smoothing by Spline Functions, in its discrete form (Whittaker 1922).
    """
    count = before + 1 + after
    differences = np.diff(np.eye(count), 2, axis=0)
    matrix = np.eye(count) + SPLINE_PENALTY * differences.T @ differences
    return np.asarray(np.linalg.solve(matrix, np.eye(count)[before]), dtype=np.float64)


def _share(cutoff_hz: Float64[ndarray, "*n"], seconds: float) -> Float64[ndarray, "*n"]:
    """How much of a new value a low-pass takes: 1 / (1 + tau / T), tau = 1 / (2 pi cutoff)."""
    return np.asarray(1 / (1 + 1 / (2 * np.pi * cutoff_hz * seconds)), dtype=np.float64)
