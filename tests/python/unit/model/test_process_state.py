"""What belongs to the process is as it was once all threads that changed it have left."""

from __future__ import annotations

import subprocess
import sys
import threading
import warnings
from collections.abc import Callable

import pytest

from sfmcpp.model.process_state import SharedChange, without_warnings


def test_one_thread_at_a_time_sets_filters_of_warnings() -> None:
    before, entered = list(warnings.filters), threading.Event()

    def enter() -> None:
        with without_warnings():
            entered.set()

    other = threading.Thread(target=enter)
    with without_warnings():
        other.start()
        assert not entered.wait(0.1)
    other.join()
    assert entered.is_set()
    assert warnings.filters == before


def test_the_warnings_meant_are_left_out_and_no_others() -> None:
    with without_warnings("of this"):
        warnings.warn("of this kind", stacklevel=1)
        with pytest.raises(UserWarning, match="of that"):
            warnings.warn("of that kind", stacklevel=1)
    with without_warnings():
        warnings.warn("of any kind", stacklevel=1)


def test_the_last_to_leave_takes_the_change_back() -> None:
    said: list[str] = []

    def make() -> Callable[[], None]:
        said.append("made")
        return lambda: said.append("taken back")

    change = SharedChange(make)
    for _ in range(2):
        one, other = change.made(), change.made()
        one.__enter__()
        other.__enter__()
        one.__exit__(None, None, None)
        assert said[-1] == "made"
        other.__exit__(None, None, None)
    assert said == ["made", "taken back"] * 2


def test_what_is_raised_inside_takes_the_change_back() -> None:
    said: list[str] = []
    change = SharedChange(lambda: lambda: said.append("taken back"))
    with pytest.raises(KeyError), change.made():
        raise KeyError
    assert said == ["taken back"]


def test_a_fork_waits_for_the_thread_that_has_set_filters() -> None:
    code = """
import os, signal, sys, threading
from sfmcpp.model.process_state import without_warnings
entered, leave = threading.Event(), threading.Event()
def hold():
    with without_warnings():
        entered.set()
        leave.wait()
threading.Thread(target=hold).start()
entered.wait()
threading.Timer(0.3, leave.set).start()
child = os.fork()
if child == 0:
    signal.alarm(30)
    with without_warnings():
        os._exit(0)
sys.exit(os.waitpid(child, 0)[1])
"""
    assert subprocess.run([sys.executable, "-c", code], timeout=120, check=False).returncode == 0
