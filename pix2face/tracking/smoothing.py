"""Smooths landmarks over the frames of a clip, and measures their jitter.

Smoothers take one frame at a time and return it after a bounded number of further frames, so clips can be of any
length. docs/explanation/detection_and_tracking.md compares their jitter, lag and delay.
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

# Weight of the squared second differences in the smoothing spline. With it, half the amplitude of an oscillation with a
# period of 6 frames passes, and three quarters with a period of 8.
SPLINE_PENALTY = 1.0
# Frames on either side. Beyond, the spline's weights are below 1e-3.
SPLINE_REACH = 12

# One-Euro filter: cut-off at rest, increase of the cut-off (Hz) with speed (eye distances per second), and cut-off of
# the low-pass that smooths the speed.
REST_CUTOFF_HZ = 2.0
CUTOFF_PER_SPEED = 8.0
SPEED_CUTOFF_HZ = 1.0


class Smoother(ABC):
    """Smooths a sequence of point sets of one shape."""

    delay: int  # number of later frames that a frame waits for

    @abstractmethod
    def push(self, points: Float[ndarray, "n d"], unit: float) -> list[Float64[ndarray, "n d"]]:
        """Takes the next frame, and returns those that are now smoothed, in order.

        Args:
            points: Points in any unit.
            unit: Eye distance of the face in the same unit.
        """

    @abstractmethod
    def flush(self) -> list[Float64[ndarray, "n d"]]:
        """Returns the remaining frames. The next frame begins a new sequence."""


@final
class WindowSmoother(Smoother):
    """A weighted mean over a window around each frame. The window shrinks towards the ends of the sequence.

    Args:
        reach: Frames on either side.
        weights: Takes the numbers of frames before and after the frame (at most ``reach``), and returns a weight for
            each frame of the window. The weights sum to 1.
    """

    def __init__(self, reach: int, weights: Callable[[int, int], Float64[ndarray, " w"]]) -> None:
        self.delay = reach
        self._weights = weights
        self._window: list[Float64[ndarray, "n d"]] = []
        self._next = 0  # index in the window of the next frame to return

    def push(self, points: Float[ndarray, "n d"], unit: float) -> list[Float64[ndarray, "n d"]]:
        """See the base class. The unit has no effect on a weighted mean."""
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
    """A low-pass for each landmark whose cut-off rises with the landmark's speed. It uses no later frames.

    Source: Casiez, Roussel and Vogel 2012, 1€ Filter. Here, the speed is that of a landmark (not of a coordinate) in
    eye distances per second, so that one setting suits faces of any size.

    Args:
        fps: Frames per second.
    """

    delay = 0

    def __init__(self, fps: float) -> None:
        self._seconds = 1 / fps
        # Smoothed points, raw points and velocity of the last frame.
        self._before: tuple[ndarray, ndarray, ndarray] | None = None

    def push(self, points: Float[ndarray, "n d"], unit: float) -> list[Float64[ndarray, "n d"]]:
        """See the base class."""
        raw = points.astype(np.float64)
        if self._before is None:
            smoothed, velocity = raw, np.zeros_like(raw)
        else:
            smoothed, last_raw, velocity = self._before
            change = (raw - last_raw) / (unit * self._seconds) - velocity
            velocity = velocity + _low_pass_gain(np.array(SPEED_CUTOFF_HZ), self._seconds) * change
            speed = np.linalg.norm(velocity, axis=1, keepdims=True)
            gain = _low_pass_gain(REST_CUTOFF_HZ + CUTOFF_PER_SPEED * speed, self._seconds)
            smoothed = smoothed + gain * (raw - smoothed)
        self._before = smoothed, raw, velocity
        return [smoothed]

    def flush(self) -> list[Float64[ndarray, "n d"]]:
        """See the base class."""
        self._before = None
        return []


@final
class JitterMeter:
    """Computes the mean second difference of landmarks over time, as a share of the eye distance."""

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
        """Begins a new sequence: the next frame does not follow the last one."""
        self._last = []

    @property
    def share(self) -> float | None:
        """Mean over landmarks and frames; None without three consecutive frames."""
        return self._total / self._count if self._count else None


def open_smoother(kind: str, fps: float) -> Smoother:
    """Returns the smoother of a name.

    "mean3" is the mean of three frames, as in the paper. "one-euro" uses no later frames. "spline" is a smoothing
    spline with 12 frames on either side.

    Raises:
        UsageError: There is no such smoother.
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
    """Returns a third for each frame. The first and last are not smoothed, since a mean of two would shift them."""
    if before and after:
        return np.full(3, 1 / 3)
    weights = np.zeros(before + 1 + after)
    weights[before] = 1
    return weights


@cache
def _spline_weights(before: int, after: int) -> Float64[ndarray, " w"]:
    """Returns the row of (I + lambda D'D)^-1 for the frame, where D is the matrix of second differences of the window.

    Source: Reinsch 1967, Smoothing by Spline Functions, in its discrete form (Whittaker 1922).
    """
    count = before + 1 + after
    differences = np.diff(np.eye(count), 2, axis=0)
    matrix = np.eye(count) + SPLINE_PENALTY * differences.T @ differences
    return np.asarray(np.linalg.solve(matrix, np.eye(count)[before]), dtype=np.float64)


def _low_pass_gain(cutoff_hz: Float64[ndarray, "*n"], seconds: float) -> Float64[ndarray, "*n"]:
    """Returns the weight of the new value in a low-pass: 1 / (1 + tau / T), where tau = 1 / (2 pi cutoff)."""
    return np.asarray(1 / (1 + 1 / (2 * np.pi * cutoff_hz * seconds)), dtype=np.float64)
