"""Runs cases one after the other in a process with limits on time, memory and open files.

A case passes when its reader returns, or refuses the file in one line of a bounded length. A crash, a limit that is
passed, any other exception and a file left open are failures. The process that runs them is started again behind a case
that ends it.
"""

import gc
import multiprocessing
import os
import resource
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from time import perf_counter
from types import FrameType

from pix2face.errors import Pix2FaceError

LONGEST_S = 10
# Beyond what the interpreter with its libraries has mapped already.
LARGEST_BYTES = 3 << 29
MOST_OPEN_FILES = 64
LONGEST_MESSAGE = 5000


Case = Callable[[], object]


@dataclass(frozen=True)
class Outcome:
    """How a case ended."""

    case: int
    verdict: str  # "read", "refused", or what went wrong
    seconds: float = 0.0
    peak_mb: float = 0.0  # beyond the most that the process had used before

    @property
    def is_failure(self) -> bool:
        """Whether the reader did not do as it promises."""
        return self.verdict not in ("read", "refused")


class TooSlowError(BaseException):
    """A case passed its time; no reader can take this for an error of the file."""


def run_cases(cases: Sequence[Case]) -> Iterator[Outcome]:
    """Runs cases, each a call that reads a file, and yields the outcome of each."""
    first = 0
    while first < len(cases):
        receiver, sender = multiprocessing.Pipe(duplex=False)
        process = multiprocessing.get_context("fork").Process(target=_run, args=(cases, first, sender))
        process.start()
        sender.close()
        try:
            while first < len(cases):
                yield receiver.recv()
                first += 1
        except EOFError:
            process.join()
            yield Outcome(first, f"the process ended with status {process.exitcode}")
            first += 1
        process.join()
        receiver.close()


def _run(cases: Sequence[Case], first: int, sender: Connection) -> None:
    _silence()
    gc.freeze()  # what the parent holds need not be looked through again and again
    signal.signal(signal.SIGALRM, _too_slow)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, 2 * (pages * resource.getpagesize() + LARGEST_BYTES,))
    resource.setrlimit(resource.RLIMIT_NOFILE, 2 * (_n_open() + MOST_OPEN_FILES,))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for index in range(first, len(cases)):
        sender.send(_outcome(index, cases[index]))


def _outcome(index: int, case: Case) -> Outcome:
    n_open, before, start = _n_open(), _peak_mb(), perf_counter()
    signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            case()
        verdict = "read"
    except Pix2FaceError as error:
        verdict = _verdict(str(error))
    except TooSlowError:
        verdict = f"longer than {LONGEST_S} s"
    except BaseException as error:  # noqa: BLE001 (whatever it is, it is a finding)
        verdict = f"{type(error).__name__}: {error}"[:300]
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    seconds = perf_counter() - start
    if _n_open() > n_open:
        verdict = f"{_n_open() - n_open} files left open; {verdict}"
    return Outcome(index, verdict, seconds, max(0.0, _peak_mb() - before))


def _verdict(message: str) -> str:
    if len(message) > LONGEST_MESSAGE:
        return f"a message of {len(message)} characters: {message[:80]}"
    return "refused"


def _too_slow(signal_number: int, frame: FrameType | None) -> None:
    raise TooSlowError


def _n_open() -> int:
    return len(os.listdir("/proc/self/fd"))  # noqa: PTH208 (counted after every case)


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _silence() -> None:
    """Libraries of pictures and videos write to the terminal themselves."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    os.close(nothing)
