"""A SLAM run written to a results folder, shown while it runs; Ctrl-C ends it between two frames."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp import slam
from sfmcpp.cli.checkpoints import Checkpoints
from sfmcpp.cli.console import (
    ExitCode,
    print_error,
    print_no_result,
    print_note,
    print_result,
    progress_is_seen,
    stderr_console,
)
from sfmcpp.cli.display import REFRESHES_PER_SECOND
from sfmcpp.cli.interrupts import noted_interrupt
from sfmcpp.cli.targets import require_results_folder, writable_folder
from sfmcpp.errors import InvalidArgument
from sfmcpp.slam import SlamResult
from sfmcpp.sources.drives import open_drive
from sfmcpp.study.slam_report import SlamReport, require_pictures

_POLL_S = 0.1

# Called as ``show(frame, result, last=False)`` after each frame.
Show = Callable[..., None]


def run_slam_files(
    source: Path,
    folder: Path,
    settings: dict[str, Any],
    opening: dict[str, Any],
    checkpoints: Checkpoints,
    *,
    view: bool,
    quiet: bool,
) -> ExitCode:
    """Read, run, write, print. What can be checked is checked before the run.

    Raises
    ------
    DatasetError
        If the input cannot be read, or the folder cannot be written.
    InvalidArgument
        If an option asks for what there is not.
    """
    require_pictures(folder)
    from sfmcpp.study.slam_files import FILES  # which draws pictures

    require_results_folder(folder, FILES)
    checkpoints.check(quiet=quiet)
    drive = open_drive(source, **opening)
    count = len(drive.frames)
    with (
        writable_folder(folder),
        _live_page(source.stem, count, quiet) if view else nullcontext(_show_nothing) as page,
    ):
        with _shown_progress(count, quiet) as show, noted_interrupt() as asked_to_stop:

            def listen(frame: int, result: SlamResult) -> bool:
                show(frame, result)
                page(frame, result)
                return not asked_to_stop()

            run = slam.run(
                drive, callback=listen, checkpoint=checkpoints.save, resume=checkpoints.resume, **settings
            )
        page(run.frames - 1, run.result, last=True)
        code = _finish(SlamReport(run), folder, checkpoints, quiet)
        if view and not run.interrupted:
            _keep_serving(quiet)
    return code


def _finish(found: SlamReport, folder: Path, checkpoints: Checkpoints, quiet: bool) -> ExitCode:
    run = found.run
    with noted_interrupt():
        written = found.write(folder)
    if run.world is None:
        if run.interrupted:
            note = f"see {folder / 'report.json'} for the progress made"
            print_note(f"interrupted before a map was started: {'; '.join((note, *checkpoints.in_words))}")
            return ExitCode.INTERRUPTED
        return print_no_result(f"{run.drive.path}: no map could be started: {run.result.message}")
    if not quiet:
        print_result(found.table(written))
    if run.interrupted:
        frames = f"{run.frames} of {len(run.drive.frames)} frames"
        note = f"results so far are in {folder}"
        print_note(f"interrupted after {frames}: {'; '.join((note, *checkpoints.in_words))}")
        return ExitCode.INTERRUPTED
    if checkpoints.failures:
        return print_error("; ".join(map(str, checkpoints.failures)))
    return ExitCode.DONE


def _show_nothing(frame: int, result: SlamResult, *, last: bool = False) -> None:
    """Show nothing."""


@contextmanager
def _shown_progress(num_frames: int, quiet: bool) -> Iterator[Show]:
    """Show the frames given to the listener, on a terminal only: a bar and one line of numbers."""
    if quiet or not progress_is_seen():
        yield _show_nothing
        return
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (
        BarColumn(bar_width=12),
        TextColumn("frame {task.completed}/{task.total}"),
        TextColumn("{task.description}"),
    )
    options: dict[str, Any] = {"refresh_per_second": REFRESHES_PER_SECOND, "redirect_stdout": False}
    progress = Progress(*columns, console=stderr_console(), **options)
    task = progress.add_task("", total=num_frames)
    shown, latest, again = -math.inf, -1, ""

    def show(frame: int, result: SlamResult, *, last: bool = False) -> None:
        """Pass on the last frame, and as many of the others as anybody could read."""
        nonlocal shown, latest, again
        again = "once more, without what was wrong · " if frame < latest else again
        now, latest, done = time.perf_counter(), frame, frame + 1 >= num_frames
        if now - shown < 1 / REFRESHES_PER_SECOND and not done:
            return
        shown = now
        progress.start()  # with the first frame: a run that is refused draws nothing
        status = "the whole map is adjusted and checked" if done else _status(result, frame + 1)
        progress.update(task, completed=frame + 1, description=again + status)

    try:
        yield show
    finally:
        progress.stop()


def _status(result: SlamResult, frames: int) -> str:
    """State of a run in a few words."""
    if result.world is None:
        return "initialising"
    points = int(np.count_nonzero(result.world.known))
    lost = f" · {len(result.lost)} lost" if result.lost else ""
    fps = frames / max(result.seconds, 1e-9)
    return f"{len(result.world.keyframes)} keyframes · {points:,} points{lost} · {fps:.0f} frames/s"


@contextmanager
def _live_page(title: str, num_frames: int, quiet: bool) -> Iterator[Show]:
    """`--view`: serve the map on a page as long as the block runs, and print its address."""
    from sfmcpp.study.plotting.live_view import LiveView

    try:
        page = LiveView(title)
    except ModuleNotFoundError as error:
        raise InvalidArgument(f"view: {error}") from None

    def show(frame: int, result: SlamResult, *, last: bool = False) -> None:
        if last or page.due:
            status = _status(result, frame + 1)
            page.show(result, f"frame {frame + 1} of {num_frames} · {status}")

    try:
        if not quiet:
            print_note(f"live map: {page.url}")
        yield show
    finally:
        page.close()


def _keep_serving(quiet: bool) -> None:
    with noted_interrupt() as asked_to_stop:  # before it is said: who reads that may be quick
        if not quiet:
            print_note("the page stays open until Ctrl-C")
        while not asked_to_stop():
            time.sleep(_POLL_S)
