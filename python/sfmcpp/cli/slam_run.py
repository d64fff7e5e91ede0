"""From a SLAM input to a folder of results."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from sfmcpp.cli.exit_codes import ExitCode, say, tell, tell_error
from sfmcpp.cli.mounting_files import mounting_of
from sfmcpp.cli.slam_images import ImageStream
from sfmcpp.cli.slam_input import SlamInput, read_input, read_measurements, sensors_of
from sfmcpp.cli.slam_job import Measured, SlamJob
from sfmcpp.cli.slam_output import require_pictures, write_report_of, write_results
from sfmcpp.cli.slam_progress import shown_progress
from sfmcpp.cli.slam_report import lines_of
from sfmcpp.cli.slam_view import ViewedRun, require_view, viewed_run
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.slam import MotionSensor, SlamResult, run_slam
from sfmcpp.sources.io.failures import failures_named


class _StoppedByUser(Exception):
    """Ends the loop between two frames."""


@dataclass
class _Listener:
    """Keeps what there is after each frame, shows it, and stops the loop where it is whole."""

    show: Callable[[int, SlamResult], None]
    view: ViewedRun | None
    asked_to_stop: Callable[[], bool]
    frames: int = 0
    result: SlamResult = field(default_factory=lambda: SlamResult(message="no frame was looked at"))

    def __call__(self, frame: int, result: SlamResult) -> None:
        self.frames, self.result = frame + 1, result
        self.show(frame, result)
        if self.view is not None:
            self.view(frame, result)
        if self.asked_to_stop():
            raise _StoppedByUser


def run_job(job: SlamJob) -> ExitCode:
    """Read, run, write, print. What can be checked is checked before the run.

    Raises
    ------
    DatasetError
        If the input cannot be read, or the folder cannot be written.
    InvalidArgument
        If an option asks for what there is not.
    """
    require_pictures(job.output)
    if job.view:
        require_view()
    if job.output.exists() and not job.output.is_dir():
        raise DatasetError(job.output, "is a file, a folder is wanted")
    started = time.perf_counter()
    if job.sensor_file is not None and not job.sensors:
        raise InvalidArgument("sensor_file: no --sensor is named that could use it")
    measured_apart = None if job.sensor_file is None else read_measurements(job.sensor_file)
    given = read_input(job.source, job.images, measured_apart)
    sensors = sensors_of(job.sensors, given, measured_apart, mounting_of(job.mounting))
    seconds_read = time.perf_counter() - started
    with _made(job.output), viewed_run(job, len(given.frames)) as view:
        measured = _run(job, given, sensors, seconds_read, view)
        code = _finish(job, given, measured)
        if view is not None and not measured.interrupted:
            _keep_serving(job, view)
    return code


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Make a folder; a run that fails leaves none that is empty."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    with failures_named(folder):
        folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        for path in missing:
            with suppress(OSError):
                path.rmdir()
        raise


def _run(
    job: SlamJob,
    given: SlamInput,
    sensors: list[MotionSensor],
    seconds_read: float,
    view: ViewedRun | None,
) -> Measured:
    started = time.perf_counter()
    interrupted = False
    with shown_progress(len(given.frames), quiet=job.quiet) as show, _ctrl_c_noted() as asked_to_stop:
        listener = _Listener(show, view, asked_to_stop)
        try:
            run_slam(given.frames, job.settings, sensors, callback=listener)
        except _StoppedByUser:
            interrupted = True
    seconds = time.perf_counter() - started
    tracking = given.frames.seconds if isinstance(given.frames, ImageStream) else None
    if view is not None:
        view.show(listener.frames, listener.result)
    return Measured(listener.result, listener.frames, seconds, seconds_read, interrupted, tracking)


def _keep_serving(job: SlamJob, view: ViewedRun) -> None:
    if not job.quiet:
        tell("the map stays on its page until Ctrl-C")
    with _ctrl_c_noted() as asked_to_stop:
        view.serve(asked_to_stop)


@contextmanager
def _ctrl_c_noted() -> Iterator[Callable[[], bool]]:
    """Take note of the first Ctrl-C, so that no frame is left half done; the second one ends at once."""
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    asked = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        asked.set()
        signal.signal(signal.SIGINT, before)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGINT, before)


def _finish(job: SlamJob, given: SlamInput, measured: Measured) -> ExitCode:
    result = measured.result
    if result.world is None:
        write_report_of(job, given, measured)
        if measured.interrupted:
            tell(f"interrupted before there was a map: {job.output / 'report.json'} tells how far it came")
            return ExitCode.INTERRUPTED
        tell(f"error: {job.source}: no map could be started: {result.message}")
        return ExitCode.NUMERICAL_FAILURE
    comparison, written, complaints = write_results(job, given, measured)
    if complaints:
        return tell_error("; ".join(map(str, complaints)))
    if not job.quiet:
        say("\n".join(lines_of(job, given, measured, comparison, written)))
    if measured.interrupted:
        frames = f"{measured.frames} of {len(given.frames)} frames"
        tell(f"interrupted after {frames}: what there is of them is in {job.output}")
        return ExitCode.INTERRUPTED
    return ExitCode.DONE
