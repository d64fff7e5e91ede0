"""The display of a running solve: the last iterations, on a terminal only."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise

from rich.console import Console
from rich.live import Live
from rich.table import Table

from sfmcpp.ba import Iteration

ROWS = 8
REFRESHES_PER_SECOND = 8.0

Listener = Callable[[Iteration], None]


class RecentIterations:
    """The last iterations as a table; drawn by a thread of its own, so that listening costs an append."""

    def __init__(self) -> None:
        self._iterations: deque[Iteration] = deque(maxlen=ROWS + 1)

    def add(self, iteration: Iteration) -> None:
        """Take note of an iteration."""
        self._iterations.append(iteration)

    def __rich__(self) -> Table:
        table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2))
        for column in ("iteration", "cost", "decrease", "damping", "seconds"):
            table.add_column(column, justify="right", no_wrap=True)
        iterations = list(self._iterations)
        if iterations and iterations[0].iteration == 0:
            table.add_row(*_cells(None, iterations[0]))
        for previous, current in pairwise(iterations):
            table.add_row(*_cells(previous, current), style="" if current.accepted else "dim")
        return table


@contextmanager
def shown_progress(*, quiet: bool) -> Iterator[Listener | None]:
    """Show the iterations given to the listener; None if nobody would see them."""
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    recent = RecentIterations()
    console = Console(stderr=True)
    with Live(recent, console=console, refresh_per_second=REFRESHES_PER_SECOND, redirect_stdout=False):
        yield recent.add


def _cells(previous: Iteration | None, current: Iteration) -> tuple[str, ...]:
    return (
        str(current.iteration),
        f"{current.cost:.6e}",
        "" if previous is None else _decrease(previous, current),
        "" if previous is None else f"{current.damping:.1e}",
        f"{current.seconds:.3f}",
    )


def _decrease(previous: Iteration, current: Iteration) -> str:
    if not current.accepted:
        return "rejected"
    return f"{1 - current.cost / previous.cost:.2e}" if previous.cost > 0 else "0"
