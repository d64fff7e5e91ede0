"""The display of a running SLAM: one line of numbers and a bar, on a terminal only."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from sfmcpp.slam import SlamResult

REFRESHES_PER_SECOND = 8.0

Show = Callable[[int, SlamResult], None]


@contextmanager
def shown_progress(num_frames: int, *, quiet: bool) -> Iterator[Show]:
    """Show the frames given to the listener; it does nothing if nobody would see them."""
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield lambda frame, result: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (
        BarColumn(bar_width=12),
        TextColumn("frame {task.completed}/{task.total}"),
        TextColumn("{task.description}"),
    )
    console = Console(stderr=True)
    with Progress(
        *columns, console=console, refresh_per_second=REFRESHES_PER_SECOND, redirect_stdout=False
    ) as progress:
        task = progress.add_task("", total=num_frames)
        yield _shower(num_frames, lambda done, text: progress.update(task, completed=done, description=text))


def _shower(num_frames: int, update: Callable[[int, str], None]) -> Show:
    """Pass on the last frame, and as many of the others as anybody could read."""
    started, shown = time.perf_counter(), -np.inf

    def show(frame: int, result: SlamResult) -> None:
        nonlocal shown
        now = time.perf_counter()
        if now - shown < 1 / REFRESHES_PER_SECOND and frame + 1 < num_frames:
            return
        shown = now
        update(frame + 1, status(result, (frame + 1) / max(now - started, 1e-9)))

    return show


def status(result: SlamResult, fps: float) -> str:
    """Say how a run stands in a few words."""
    if result.world is None:
        return "looking for a start"
    points = int(np.count_nonzero(result.world.known))
    lost = f" · {len(result.lost)} lost" if result.lost else ""
    return f"{len(result.world.keyframes)} keyframes · {points:,} points{lost} · {fps:.0f} frames/s"
