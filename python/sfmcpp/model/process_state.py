"""What belongs to the whole process: its memory, and what several threads change for a while."""

from __future__ import annotations

import os
import re
import resource
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import RLock


def _lock_open_in_children() -> RLock:
    """A lock for which a fork waits: the thread that holds it is not there in the child."""
    lock = RLock()
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=lock.acquire, after_in_parent=lock.release, after_in_child=lock.release)
    return lock


_FILTERS = _lock_open_in_children()


@contextmanager
def without_warnings(message: str = "") -> Iterator[None]:
    """Inside, no warnings; one thread at a time is inside.

    Two at once would each restore what the other had set: its filters would stay.

    Parameters
    ----------
    message : str
        Regular expression that the beginning of a warning must match. Default: all are left out.
    """
    with _FILTERS, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message)
        yield


class SharedChange:
    """A change that the first thread inside makes, and that the last one takes back.

    Parameters
    ----------
    make : callable
        Makes it, and returns what takes it back.
    """

    def __init__(self, make: Callable[[], Callable[[], None]]) -> None:
        self._make, self._lock, self._inside = make, _lock_open_in_children(), 0
        self._take_back: Callable[[], None] = lambda: None

    @contextmanager
    def made(self) -> Iterator[None]:
        """Inside, the change is made."""
        with self._lock:
            if not self._inside:
                self._take_back = self._make()
            self._inside += 1
        try:
            yield
        finally:
            with self._lock:
                self._inside -= 1
                if not self._inside:
                    self._take_back()


def peak_memory_bytes() -> int:
    """Largest resident memory of this process so far [bytes].

    Linux tells it by process image; the portable figure there includes what the parent held when it forked.
    """
    with suppress(OSError):
        match = re.search(r"^VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text(), re.MULTILINE)
        if match:
            return 1024 * int(match[1])
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
