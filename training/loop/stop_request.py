"""Ctrl-C and SIGTERM ask a training to end; it finishes its step and writes its state first."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import final

from pix2face.stop_signals import exit_status_of, first_signal


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
        return 0 if self.number is None else exit_status_of(self.number)

    def is_made(self) -> bool:
        """Whether to stop."""
        return self.number is not None

    def note(self, number: int) -> None:
        """Notes a signal."""
        self.number = number


@contextmanager
def noted_signals() -> Iterator[StopRequest]:
    """Notes the first signal; the second one ends the process at once."""
    request = StopRequest()
    with first_signal(request.note):
        yield request
