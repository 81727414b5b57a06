"""Where the time of a job goes: seconds of the processor by stage, added up over workers."""

import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import final


@final
class StageTimes:
    """A stopwatch with one hand for each stage.

    Attributes:
        cpu_seconds: Time that this process had the processor, by stage; other jobs on the machine do not change it.
    """

    def __init__(self) -> None:
        self.cpu_seconds: dict[str, float] = defaultdict(float)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts what happens inside as a stage. Stages do not contain each other."""
        started = time.process_time()
        try:
            yield
        finally:
            self.cpu_seconds[name] += time.process_time() - started

    def add(self, cpu_seconds: Mapping[str, float]) -> None:
        """Adds what another stopwatch measured."""
        for name, value in cpu_seconds.items():
            self.cpu_seconds[name] += value
