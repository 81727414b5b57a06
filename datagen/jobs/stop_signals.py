"""Ctrl-C and SIGTERM end a long job cleanly: the first asks, the second kills."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import final

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@final
class StoppedBySignal(BaseException):
    """A signal asked the process to stop.

    Attributes:
        exit_status: What a shell reports of a process that this signal ended.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.exit_status = 128 + number


@contextmanager
def stopping_on_signals() -> Iterator[None]:
    """Raises StoppedBySignal at the first signal, whatever is under way; the second ends the process at once.

    Elsewhere than in the main thread, where signals do not arrive, it does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        for other in SIGNALS:
            signal.signal(other, signal.SIG_DFL)
        raise StoppedBySignal(number)

    before = {number: signal.signal(number, stop) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
