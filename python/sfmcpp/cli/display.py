"""Terminal output of a solve: recent iterations while it runs, a table at its end."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from io import StringIO
from itertools import pairwise
from pathlib import Path

from rich import progress as bars
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from sfmcpp.ba import Iteration, LinearSolverForecast, RankLoad, Summary
from sfmcpp.ba.parts import ProblemSize
from sfmcpp.cli.console import print_result, progress_is_seen, stderr_console
from sfmcpp.cli.targets import Targets
from sfmcpp.model.process_state import peak_memory_bytes
from sfmcpp.model.threads import Progress, no_progress
from sfmcpp.wording import counted

ROWS = 8
_PREDICTED = "predicted for a step"
REFRESHES_PER_SECOND = 8.0

Listener = Callable[[Iteration], None]
WIDTH_OF_FILES = 120

TERMINATIONS = {
    "converged": ("converged", "green"),
    "max_iterations": ("stopped at the iteration limit", "yellow"),
    "max_seconds": ("stopped at the time limit", "yellow"),
    "interrupted": ("interrupted", "yellow"),
    "stopped_by_callback": ("stopped by the callback", "yellow"),
    "stalled": ("stalled before a minimum", "yellow"),
    "numerical_failure": ("numerical failure", "red"),
}


def print_summary(
    source: Path,
    size: ProblemSize,
    summary: Summary,
    seconds_read: float,
    targets: Targets,
    georeferenced: Iterable[Row],
) -> None:
    """Print what was solved, how it ended, where the world is and what was written."""
    rows = [*_size(source, size), *_result(summary), *georeferenced, *_method_text(summary, seconds_read)]
    rows += [("warning", Text(warning, style="yellow")) for warning in summary.warnings]
    rows += [("written", str(path)) for path in targets]
    if targets.problem is None:
        rows.append(("result", "not saved; use -o FILE to write it"))
    print_result(facts_text(rows))


def facts_text(rows: Iterable[Row]) -> str:
    """Lines of names and what there is to say of each."""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(Text(name), value if isinstance(value, Text) else Text(value))
    return rendered(table)


def rendered(table: Table) -> str:
    """Lines of a table, as wide as the terminal; elsewhere as files have it."""
    at_terminal = sys.stdout is not None and sys.stdout.isatty()
    lines = StringIO()
    width = None if at_terminal else WIDTH_OF_FILES
    Console(file=lines, force_terminal=at_terminal or None, width=width).print(table)
    return "\n".join(line.rstrip() for line in lines.getvalue().splitlines())


Row = tuple[str, "str | Text"]


def _size(source: Path, size: ProblemSize) -> Iterator[Row]:
    yield "input", str(source)
    if size.num_frames is not None:
        free = size.num_free_sensors
        sensors = f"{free:,} of {size.num_sensors:,} sensors free" if free else "sensors fixed"
        yield "rigs", f"solved as rigs: one pose for each of {size.num_frames:,} frames, {sensors}"
    yield (
        "size",
        f"{size.num_cameras:,} cameras, {size.num_points:,} points, {size.num_observations:,} observations",
    )


def _result(summary: Summary) -> Iterator[Row]:
    words, style = TERMINATIONS[summary.termination]
    yield "cost", f"{summary.initial_cost:.6e} → {summary.final_cost:.6e}"
    yield f"RMS [{summary.rms_unit}]", f"{summary.initial_rms_px:.6g} → {summary.final_rms_px:.6g}"
    yield "termination", Text(words, style=style).append(f": {summary.message}", style="default")
    yield "iterations", summary.describe_steps()


def _method_text(summary: Summary, seconds_read: float) -> Iterator[Row]:
    threads = counted(summary.threads, "thread")
    search = "" if summary.line_search == "none" else f", line search {summary.line_search}"
    yield "method", f"{summary.method}{search}, {threads}"
    if summary.loss != "squared":
        yield "loss", f"{summary.loss}, scale {summary.loss_scale_px:.4g} {summary.rms_unit}"
    yield "linear solver", f"{summary.linear_solver} ({_why(summary)})"
    for change in summary.linear_solver_changes:
        yield "linear solver", f"{change.solver} from step {change.solves + 1} ({change.reason})"
    for rank, load in enumerate(summary.ranks):
        yield f"rank {rank}", _rank_load_text(load)
    yield "seconds", f"{summary.seconds_total:.3f}, plus {seconds_read:.3f} for reading the input"
    yield "peak memory", f"{peak_memory_bytes() / 1e6:.0f} MB"


def _rank_load_text(load: RankLoad) -> str:
    return (
        f"{load.points:,} points, {load.observations:,} observations; "
        f"{load.seconds_computing:.3f} s computing, {load.seconds_waiting:.3f} s waiting, "
        f"{load.bytes_sent / 1e6:.1f} MB sent"
    )


def _why(summary: Summary) -> str:
    """Why this linear solver was chosen; the forecasts once, with the memory of the whole solve."""
    reason, forecasts = summary.linear_solver_reason, summary.linear_solver_forecast
    if not forecasts:
        return reason
    predicted = f"{_PREDICTED}: {', '.join(map(_forecast, forecasts))}"
    return predicted if reason.startswith(_PREDICTED) else f"{reason}; {predicted}"


def _forecast(forecast: LinearSolverForecast) -> str:
    seconds = forecast.seconds
    time = f"{seconds:.2g} s" if seconds >= 1 else f"{1e3 * seconds:.2g} ms"
    with_blocks = " with S in blocks" if forecast.iterations and "blocks" in forecast.work_of_step else ""
    return f"{forecast.solver}{with_blocks} {time} and {forecast.bytes / 1e6:.0f} MB"


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
    if quiet or not progress_is_seen():
        yield None
        return
    recent = RecentIterations()
    console = stderr_console()
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


@contextmanager
def shown_stages(*, quiet: bool) -> Iterator[Progress]:
    """Show the stages of a run, each with a bar and the time that remains; on a terminal only.

    It gives ``show(stage, done, total)``, which asks for no stop; a total of 0 is not known yet.
    """
    if quiet or not progress_is_seen():
        yield no_progress
        return
    columns = (
        bars.TextColumn("{task.description:<12}"),
        bars.BarColumn(bar_width=24),
        bars.MofNCompleteColumn(),
        bars.TimeRemainingColumn(compact=True, elapsed_when_finished=True),
    )
    console = stderr_console()
    tasks: dict[str, bars.TaskID] = {}
    with bars.Progress(
        *columns, console=console, refresh_per_second=REFRESHES_PER_SECOND, redirect_stdout=False
    ) as shown:

        def show(stage: str, done: int, total: int) -> bool:
            if stage not in tasks:
                tasks[stage] = shown.add_task(stage, total=total or None)
            shown.update(tasks[stage], completed=done, total=total or None)
            return False

        yield show
