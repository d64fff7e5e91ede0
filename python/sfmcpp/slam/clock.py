"""How long each stage of a keyframe takes."""

from __future__ import annotations

import time


class Clock:
    """Milliseconds of each stage."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Note what has passed since the last lap."""
        now = time.perf_counter()
        self.laps[name] = 1e3 * (now - self._last)
        self._last = now
