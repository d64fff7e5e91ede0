"""Tasks on threads, of which the system may have fewer than asked for."""

from __future__ import annotations

import os
import threading

import pytest

from sfmcpp import InvalidArgument, SolveOptions, circle_scene, solve
from sfmcpp.model.threads import at_most_threads, on_threads, thread_count


def square(number: int) -> int:
    return number * number


@pytest.mark.parametrize("started", [0, 1, 3, 99])
def test_threads_that_cannot_start_change_no_result(started: int, monkeypatch: pytest.MonkeyPatch) -> None:
    start, left = threading.Thread.start, [started]

    def start_some(self: threading.Thread) -> None:
        if not left[0]:
            raise RuntimeError("can't start new thread")
        left[0] -= 1
        start(self)

    monkeypatch.setattr(threading.Thread, "start", start_some)
    assert list(on_threads(square, range(50), 8)) == [n * n for n in range(50)]


@pytest.mark.parametrize("threads", [1, 4])
def test_what_a_task_raises_comes_in_its_turn(threads: int) -> None:
    def fail_at_three(number: int) -> int:
        if number == 3:
            raise RuntimeError("three")
        return number

    found: list[int] = []
    with pytest.raises(RuntimeError, match="three"):
        found.extend(on_threads(fail_at_three, range(50), threads))
    assert found == [0, 1, 2]


def test_no_threads_at_all_are_refused() -> None:
    assert thread_count(3) == 3
    assert thread_count(None) >= 1
    with pytest.raises(InvalidArgument, match="threads = 0: must be at least 1"):
        thread_count(0)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="only Linux binds a process to cores")
def test_there_are_no_more_threads_than_cores_that_the_process_is_bound_to() -> None:
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        assert thread_count(None) == 1
        problem = circle_scene(40, 1000, seed=0)  # enough for two threads
        assert solve(problem, max_iterations=1).threads == 1
    finally:
        os.sched_setaffinity(0, before)


def test_a_limit_holds_for_solves_within_it_and_for_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sfmcpp.model.threads.usable_cores", lambda: 8)
    with at_most_threads(3):
        assert (thread_count(), SolveOptions().threads, SolveOptions(threads=2).threads) == (3, 3, 2)
        with at_most_threads(None):
            assert thread_count() == 3
        assert solve(circle_scene(5, 30), max_iterations=1).threads == 3
    with at_most_threads(8):  # as many as there are: a solve of a small problem takes fewer
        assert SolveOptions().threads == 0
    assert (thread_count(), SolveOptions().threads) == (8, 0)
