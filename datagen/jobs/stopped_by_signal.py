"""Ctrl-C and SIGTERM end a long job where it is: finished shards stay, the rest is rendered next time."""

import signal
from contextlib import AbstractContextManager
from typing import final

from pix2face.stop_signals import exit_status_of, first_signal


@final
class StoppedBySignal(BaseException):
    """A signal asked the process to stop.

    Attributes:
        exit_status: What a shell reports of a process that this signal ended.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.exit_status = exit_status_of(number)


def stopping_on_signals() -> AbstractContextManager[None]:
    """Raises StoppedBySignal at the first signal, whatever is under way; the second ends the process at once."""

    def stop(number: int) -> None:
        raise StoppedBySignal(number)

    return first_signal(stop)
