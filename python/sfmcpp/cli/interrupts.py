"""Orderly ends by Ctrl-C, SIGTERM and SIGHUP, which are delayed while results are written.

What comes within half a second is one stop: a session that ends sends SIGTERM and SIGHUP to each of its
processes, and wrappers pass on a Ctrl-C that the terminal has sent to all.
"""

from __future__ import annotations

import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager
from types import FrameType
from typing import Any, TypeVar

T = TypeVar("T")

_AGAIN_S = 0.01
_TOGETHER_S = 0.5
_BETWEEN_QUESTIONS_S = 0.1
# A request to terminate, and a terminal or a connection that is closed; nohup lets the latter be ignored.
_REQUESTS = (signal.SIGTERM, signal.SIGHUP)


class _StopSignals:
    """Time of the last stop signal: signals shortly after it count as the same stop."""

    last_s = -math.inf

    @classmethod
    def is_new(cls) -> bool:
        now, before = time.monotonic(), cls.last_s
        if now - before < _TOGETHER_S:
            return False
        cls.last_s = now
        return True

    @classmethod
    def forget(cls) -> None:
        cls.last_s = -math.inf

    @classmethod
    def interrupt(cls, number: int, frame: FrameType | None) -> None:
        if cls.is_new():
            raise KeyboardInterrupt


@contextmanager
def termination_as_ctrl_c() -> Iterator[None]:
    """Handle SIGTERM and SIGHUP like Ctrl-C: the command ends with the best state and a report."""
    plain = (signal.SIG_DFL, signal.default_int_handler)
    before = _handlers() if _in_main_thread() else {}
    taken = {number: handler for number, handler in before.items() if handler in plain}
    _StopSignals.forget()
    try:
        for number in taken:
            signal.signal(number, _StopSignals.interrupt)
        yield
    finally:
        _restore(taken)


@contextmanager
def repeated_lost_interrupts() -> Iterator[None]:
    """Repeat an interrupt that was raised in a callback whose exceptions the interpreter ignores.

    Modules that are loaded have such callbacks: the command would go on to its end. What has not come again
    when it ends comes before that, not later into what called it.
    """
    if not _in_main_thread():
        yield
        return
    before, main_thread = sys.unraisablehook, threading.get_ident()
    waiting: list[threading.Timer] = []

    def hook(ignored: Any) -> None:
        if not issubclass(ignored.exc_type, KeyboardInterrupt):
            before(ignored)
            return
        _StopSignals.forget()
        waiting.append(threading.Timer(_AGAIN_S, signal.pthread_kill, (main_thread, signal.SIGINT)))
        waiting[-1].daemon = True
        waiting[-1].start()

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before
        for again in waiting:
            again.join()


@contextmanager
def noted_interrupt() -> Iterator[Callable[[], bool]]:
    """Record the first stop instead of raising it; the next one ends at once."""
    if not _in_main_thread():
        yield lambda: False
        return
    requested = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        if _StopSignals.is_new():
            requested.set()
            _restore(before)

    before = _handlers()  # known before the first is replaced: a stop may come between any two
    try:
        for number in before:
            signal.signal(number, note)
        if requested.is_set():
            _restore(before)
        yield requested.is_set
    finally:
        _restore(before)


def stoppable(compute: Callable[[], T], is_stopped: Callable[[], bool] = lambda: False) -> T:
    """Compute in a thread of its own, which is left to itself at a stop.

    A long call of the core that is no solve answers no signal: in the main thread it would have to end first.

    Parameters
    ----------
    compute : callable
        Must leave alone what is used after a stop: it goes on until the process ends.
    is_stopped : callable
        Whether a stop was noted instead of raised.

    Raises
    ------
    KeyboardInterrupt
        At a stop.
    """
    if not _in_main_thread():
        return compute()
    found: Future[T] = Future()

    def run() -> None:
        try:
            found.set_result(compute())
        except BaseException as error:
            found.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    while not is_stopped():
        # What was computed may have failed with a TimeoutError of its own.
        if wait([found], _BETWEEN_QUESTIONS_S).done:
            return found.result()
    raise KeyboardInterrupt


@contextmanager
def single_interrupt() -> Iterator[Callable[[], None]]:
    """Handle a stop once: a launcher of processes repeats what a terminal sends to all.

    What it gives is called where the one has come to another process, and is heeded already.
    """
    requested = threading.Event()

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not requested.is_set():
            requested.set()
            raise KeyboardInterrupt

    if not _in_main_thread():
        yield requested.set
        return
    before = _handlers()
    try:
        for number in before:
            signal.signal(number, interrupt)
        yield requested.set
    finally:
        _restore(before)


def _handlers() -> dict[signal.Signals, Any]:
    """Handlers of the stops, but for what is ignored and for functions of C, which could not be restored."""
    found = {number: signal.getsignal(number) for number in (signal.SIGINT, *_REQUESTS)}
    return {number: handler for number, handler in found.items() if handler not in (None, signal.SIG_IGN)}


def _restore(handlers: dict[signal.Signals, Any]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
