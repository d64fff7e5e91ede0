"""Whether other threads run while the core computes."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from conftest import TIMEOUT_S


@contextmanager
def ticking() -> Iterator[Callable[[], int]]:
    """Count in another thread, which gets the GIL where this one lets go of it, and no earlier."""
    count, done, interval = [0], threading.Event(), sys.getswitchinterval()

    def tick() -> None:
        while not done.is_set():
            count[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    sys.setswitchinterval(2 * TIMEOUT_S)
    try:
        yield lambda: count[0]
    finally:
        sys.setswitchinterval(interval)
        done.set()
        thread.join()


def again_until(is_seen: Callable[[], bool]) -> bool:
    """Ask again where the machine may have had no time for the other thread; whether it was seen at last."""
    deadline = time.monotonic() + TIMEOUT_S
    while not (seen := is_seen()) and time.monotonic() < deadline:
        pass
    return seen
