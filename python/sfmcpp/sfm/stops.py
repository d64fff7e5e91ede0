"""Stops that a listener asks for, heeded where a model is in order: in adjustments, and between images."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from sfmcpp.model.threads import Progress


def never() -> bool:
    """Ask for no stop."""
    return False


# Whether the run that an adjustment is part of is asked to stop.
_asked: ContextVar[Callable[[], bool]] = ContextVar("_asked", default=never)


@contextmanager
def stopped_by(asked: Callable[[], bool]) -> Iterator[None]:
    """Let what heeds stops in the context end as by Ctrl-C once `asked` returns True."""
    token = _asked.set(asked)
    try:
        yield
    finally:
        _asked.reset(token)


def heed_stop(_: object = None) -> None:
    """Raise KeyboardInterrupt if the run is asked to stop; also a callback of solves, which end by it."""
    if _asked.get()():
        raise KeyboardInterrupt


class RepeatedProgress:
    """Progress that can be told again, to hear whether to stop.

    Parameters
    ----------
    progress : callable
        Whom it is told.
    stage, total : str, int
        What is told before anything is done.
    """

    def __init__(self, progress: Progress, stage: str, total: int) -> None:
        self._progress, self._last = progress, (stage, 0, total)

    def __call__(self, stage: str, done: int, total: int) -> bool:
        """Tell it; whether to stop."""
        self._last = (stage, done, total)
        return self.again()

    def again(self) -> bool:
        """Tell once more what was told last; whether to stop."""
        return self._progress(*self._last)
