"""Tasks on threads, their results in the order of the tasks, with progress; what a stage of them takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from contextvars import ContextVar
from typing import TypeVar

from sfmcpp._core import usable_cores
from sfmcpp.model.checks import require_count

Task = TypeVar("Task")
Result = TypeVar("Result")
# Told the stage, how much of it is done and of how much; True asks to stop.
Progress = Callable[[str, int, int], bool]
_MOST: ContextVar[int | None] = ContextVar("most threads", default=None)


def on_threads(
    function: Callable[[Task], Result], tasks: Sequence[Task], threads: int
) -> Generator[Result, None, None]:
    """Results of `function` for each task, in their order; what it raises.

    Tasks that run by then are finished, the others are not begun. Where a thread cannot start, tasks may be
    done twice.
    """
    with ThreadPoolExecutor(max(1, threads)) as pool:
        try:
            results = pool.map(function, tasks)
        except RuntimeError:
            pool.shutdown(cancel_futures=True)
            results = map(function, tasks)
        try:
            yield from results
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def no_progress(stage: str, done: int, total: int) -> bool:
    """Progress that nobody looks at."""
    return False


@contextmanager
def at_most_threads(count: int | None) -> Iterator[None]:
    """Inside, what is told no number of threads takes at most `count`, solves as well; None: as outside."""
    before = _MOST.set(_MOST.get() if count is None else count)
    try:
        yield
    finally:
        _MOST.reset(before)


def thread_count(wanted: int | None = None) -> int:
    """`wanted`, or as many as the process may use; InvalidArgument if `wanted` is below one."""
    if wanted is not None:
        require_count("threads", wanted)
        return wanted
    return _MOST.get() or usable_cores()


def default_threads() -> int:
    """The default of solves: 0, by the machine and the size of the problem, unless there is a limit."""
    most = _MOST.get()
    return most if most and most < usable_cores() else 0


def results_in_order(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    threads: int,
    *,
    stage: str,
    progress: Progress,
) -> list[Result]:
    """Results of `function` for each task; what it raises, or KeyboardInterrupt if `progress` asks to stop.

    Tasks that run by then are finished, the others are not begun.
    """
    results: list[Result] = []
    report_progress(progress, stage, 0, len(tasks))
    with closing(on_threads(function, tasks, threads)) as found:
        for result in found:
            results.append(result)
            report_progress(progress, stage, len(results), len(tasks))
    return results


@contextmanager
def timed(stage: str, seconds: dict[str, float]) -> Iterator[None]:
    """Add the time that passes inside [s] to that of a stage."""
    begin = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - begin


def report_progress(progress: Progress, stage: str, done: int, total: int) -> None:
    """Tell how much of a stage is done; KeyboardInterrupt if `progress` asks to stop."""
    if progress(stage, done, total):
        raise KeyboardInterrupt(f"stopped in {stage}, {done} of {total} done")
