"""Where the time of a job goes: seconds by stage, added up over workers."""

import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import final


@final
class StageTimes:
    """A stopwatch with one hand for each stage.

    Attributes:
        seconds: Elapsed so far, by stage, in the order in which stages first came up.
        cpu_seconds: Of the processor, in this process, by stage: what another job beside it does not change.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.cpu_seconds: dict[str, float] = defaultdict(float)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts what happens inside as a stage. Stages do not contain each other."""
        started, cpu_started = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - started
            self.cpu_seconds[name] += time.process_time() - cpu_started

    def add(self, seconds: Mapping[str, float], cpu_seconds: Mapping[str, float]) -> None:
        """Adds what another stopwatch measured."""
        for name, value in seconds.items():
            self.seconds[name] += value
        for name, value in cpu_seconds.items():
            self.cpu_seconds[name] += value
