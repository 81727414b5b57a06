"""What benchmarks share: their options, times of functions, and reports that say what they were measured on."""

import argparse
import json
import os
import platform
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any
from unittest.mock import patch

PACKAGES = ("numpy", "scipy", "h5py", "torch", "onnxruntime")


def options_parser(description: str | None, out: Path | None = None) -> argparse.ArgumentParser:
    """The parser of a benchmark's options, with the file that its report is written to."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=out)
    return parser


def write_report(report: Mapping[str, object], out: Path | None = None) -> None:
    """Prints figures as JSON, with what they were measured on, and writes them to a file where one is given."""
    text = json.dumps({**report, "measured_on": surroundings()}, indent=2, ensure_ascii=False) + "\n"
    sys.stdout.write(text)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(text, encoding="utf-8")


def surroundings() -> dict[str, object]:
    """Processor, cores, and versions of what does the work."""
    return {
        "processor": platform.processor() or platform.machine(),
        "system": platform.system(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
    }


def processor_ms(calls: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Milliseconds of processor time of some calls, made in turns, after a round that is not counted."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeats + 1):
        for name, call in calls.items():
            began = time.process_time()
            call()
            times[name].append(1e3 * (time.process_time() - began))
    return {name: own[1:] for name, own in times.items()}


class StepTimes:
    """Times of functions, without those of the functions inside them that are timed as well; seconds of each call."""

    def __init__(
        self, clock: Callable[[], float] = time.thread_time, finish: Callable[[], object] | None = None
    ) -> None:
        self.seconds: dict[str, list[float]] = defaultdict(list)
        self._clock, self._finish = clock, finish
        self._thread, self._lock = threading.local(), threading.Lock()

    @contextmanager
    def of(self, steps: Iterable[tuple[str, Any, str]]) -> Iterator[None]:
        """Times functions, each given by its step, its module or class, and its name there."""
        with ExitStack() as patches:
            for step, owner, name in steps:
                patches.enter_context(patch.object(owner, name, self._timed(step, getattr(owner, name))))
            yield

    def _timed(self, step: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any, **named: Any) -> Any:
            outer, self._thread.inner = getattr(self._thread, "inner", 0.0), 0.0
            start = self._clock()
            try:
                return function(*arguments, **named)
            finally:
                if self._finish is not None:
                    self._finish()
                spent = self._clock() - start
                with self._lock:
                    self.seconds[step].append(spent - self._thread.inner)
                self._thread.inner = outer + spent

        return run
