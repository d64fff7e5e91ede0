"""Wall time and processor time of named stages; the latter hardly feels what else the machine does."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Seconds of stages, by name, in the order they ended."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.cpu_seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block; of this process, all its threads."""
        wall, processor = time.perf_counter(), time.process_time()
        yield
        self.seconds[name] = time.perf_counter() - wall
        self.cpu_seconds[name] = time.process_time() - processor

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Both tables, for JSON."""
        return {"seconds": self.seconds, "cpu_seconds": self.cpu_seconds}
