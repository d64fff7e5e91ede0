"""Tasks on some threads, or on this one alone where the system has no more."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")


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
