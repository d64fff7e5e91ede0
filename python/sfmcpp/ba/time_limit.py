"""One limit of time for several solves."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

# A solve that has no time left still tells the cost of its start [s].
_LEAST_S = 1e-3


class TimeLimit:
    """What is left of a `max_seconds` that several solves share, from when this is made.

    Parameters
    ----------
    seconds : float, optional
        The limit [s]. Default: none.
    """

    def __init__(self, seconds: float | None) -> None:
        self._end = None if seconds is None else time.monotonic() + seconds

    @property
    def is_over(self) -> bool:
        """Whether no time is left."""
        return self._end is not None and time.monotonic() >= self._end

    def of(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Options of the next solve: the same, but for `max_seconds`."""
        if self._end is None:
            return dict(options)
        return {**options, "max_seconds": max(_LEAST_S, self._end - time.monotonic())}
