"""Ctrl-C and SIGTERM end long work cleanly: the first asks, the second ends the process at once."""

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from types import FrameType
from typing import final

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def signals_blocked() -> Iterator[None]:
    """Starts processes that no signal of this kind ever reaches: they inherit what is blocked while the block runs."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def first_signal(ask: Callable[[int], None], numbers: Sequence[signal.Signals] = SIGNALS) -> Iterator[None]:
    """While the block runs, the first signal asks.

    Elsewhere than in the main thread, where signals do not arrive, it does nothing.

    Args:
        ask: Is given the signal's number; what it raises is raised in the block.
        numbers: The signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def asked(number: int, frame: FrameType | None) -> None:
        for other in numbers:
            signal.signal(other, signal.SIG_DFL)
        ask(number)

    before = {number: signal.signal(number, asked) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def collected_signals() -> Iterator[list[int]]:
    """Collects the first signal for work that looks for it from time to time, and tells the user so."""
    found: list[int] = []

    def note(number: int) -> None:
        found.append(number)
        # Not through a stream or a console, which the signal may have interrupted in the middle of a write.
        with suppress(OSError):  # nobody reads it any more: that must not end the work
            os.write(2, b"\nstopping after the step under way; a second signal ends the process at once\n")

    with first_signal(note):
        yield found


def exit_status_of(number: int) -> int:
    """What a shell reports of a process that a signal ended."""
    return 128 + number


@final
class StoppedBySignal(BaseException):
    """A signal asked the process to stop.

    Attributes:
        exit_status: What a shell reports of a process that this signal ended.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.exit_status = exit_status_of(number)


def stopping_on_signals(numbers: Sequence[signal.Signals] = SIGNALS) -> AbstractContextManager[None]:
    """Raises StoppedBySignal at the first signal, whatever is under way; the second ends the process at once."""

    def stop(number: int) -> None:
        raise StoppedBySignal(number)

    return first_signal(stop, numbers)
