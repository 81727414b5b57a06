"""Ctrl-C and SIGTERM ask a training to end; it finishes its step and writes its state first."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import final

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@final
class StopRequest:
    """Whether a signal has come.

    Attributes:
        number: The first signal; None while there was none.
    """

    def __init__(self) -> None:
        self.number: int | None = None

    @property
    def exit_status(self) -> int:
        """What a shell reports of a process that this signal ended; 0 while there was none."""
        return 0 if self.number is None else 128 + self.number

    def is_made(self) -> bool:
        """Whether to stop."""
        return self.number is not None


@contextmanager
def noted_signals() -> Iterator[StopRequest]:
    """Notes the first signal; the second one ends the process at once.

    Elsewhere than in the main thread, where signals do not arrive, none is ever noted.
    """
    request = StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return

    def note(number: int, frame: FrameType | None) -> None:
        request.number = number
        for other in SIGNALS:
            signal.signal(other, signal.SIG_DFL)

    before = {number: signal.signal(number, note) for number in SIGNALS}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
