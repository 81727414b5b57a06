"""The first signal asks, the second ends the process, and afterwards everything is as it was."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from pix2face.stop_signals import SIGNALS, collected_signals, exit_status_of, first_signal


@pytest.mark.parametrize("number", SIGNALS)
def test_the_first_signal_asks_and_work_goes_on(number: signal.Signals) -> None:
    before = [signal.getsignal(each) for each in SIGNALS]
    asked: list[int] = []
    with first_signal(asked.append):
        os.kill(os.getpid(), number)
        assert asked == [number]
        assert [signal.getsignal(each) for each in SIGNALS] == [signal.SIG_DFL] * 2  # the next one ends it
    assert [signal.getsignal(each) for each in SIGNALS] == before


def test_work_that_looks_for_signals_tells_at_once_that_one_came(capfd: pytest.CaptureFixture[str]) -> None:
    with collected_signals() as found:
        os.kill(os.getpid(), signal.SIGTERM)
        assert "stopping after the step under way; a second signal ends the process" in capfd.readouterr().err
    assert found == [signal.SIGTERM]


def test_a_closed_stderr_does_not_end_the_work() -> None:
    deaf = (
        "import os, signal\nfrom pix2face.stop_signals import collected_signals\n"
        "with collected_signals() as found:\n    os.close(2)\n    os.kill(os.getpid(), signal.SIGTERM)\n"
        "print(len(found))\n"
    )
    root = Path(__file__).parents[2]
    assert subprocess.run([sys.executable, "-c", deaf], cwd=root, capture_output=True).stdout == b"1\n"


def test_what_asking_raises_is_raised_in_the_block() -> None:
    before = [signal.getsignal(each) for each in SIGNALS]

    def stop(number: int) -> None:
        raise InterruptedError(str(number))

    with pytest.raises(InterruptedError, match=str(int(signal.SIGTERM))), first_signal(stop):
        os.kill(os.getpid(), signal.SIGTERM)
    assert [signal.getsignal(each) for each in SIGNALS] == before


def test_the_second_signal_ends_a_process_that_does_not_stop() -> None:
    deaf = (
        "import os, signal\nfrom pix2face.stop_signals import first_signal\n"
        "with first_signal(lambda number: print('asked', flush=True)):\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n    os.kill(os.getpid(), signal.SIGTERM)\n    print('deaf')\n"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", deaf], cwd=root, capture_output=True, text=True)
    assert (done.stdout, done.returncode) == ("asked\n", -signal.SIGTERM)


def test_beside_the_main_thread_nothing_is_changed() -> None:
    before = [signal.getsignal(each) for each in SIGNALS]
    found: list[object] = []

    def work() -> None:
        with first_signal(lambda number: None):
            found.extend(signal.getsignal(each) for each in SIGNALS)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == before


def test_the_exit_status_is_the_shells() -> None:
    assert [exit_status_of(number) for number in SIGNALS] == [130, 143]
