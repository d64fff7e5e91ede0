"""`--view`: the map in the browser while it grows, and after the run until Ctrl-C."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from sfmcpp.cli.exit_codes import tell
from sfmcpp.cli.slam_job import SlamJob
from sfmcpp.cli.slam_progress import status
from sfmcpp.errors import InvalidArgument
from sfmcpp.slam import SlamResult
from sfmcpp.study.plotting.live_view import LiveView, load_viser

_POLL_S = 0.1


def require_view() -> None:
    """Raise an InvalidArgument if no map can be shown."""
    try:
        load_viser()
    except ModuleNotFoundError as error:
        raise InvalidArgument(f"view: {error}") from None


class ViewedRun:
    """A run on a page; called after each frame.

    Parameters
    ----------
    page : LiveView
        Where to show it.
    num_frames : int
        Frames expected.
    """

    def __init__(self, page: LiveView, num_frames: int) -> None:
        self._page, self._num_frames = page, num_frames
        self._started = time.perf_counter()

    def __call__(self, frame: int, result: SlamResult) -> None:
        """Show the map, if it is time to."""
        if self._page.due:
            self.show(frame + 1, result)

    def show(self, frames: int, result: SlamResult) -> None:
        """Show the map after that many frames."""
        fps = frames / max(time.perf_counter() - self._started, 1e-9)
        self._page.show(result, f"frame {frames} of {self._num_frames} · {status(result, fps)}")

    def serve(self, asked_to_stop: Callable[[], bool]) -> None:
        """Keep the page until asked to stop."""
        while not asked_to_stop():
            time.sleep(_POLL_S)


@contextmanager
def viewed_run(job: SlamJob, num_frames: int) -> Iterator[ViewedRun | None]:
    """Serve the page as long as the block runs, and say where; None if it is not asked for."""
    if not job.view:
        yield None
        return
    page = LiveView(job.source.stem)
    try:
        if not job.quiet:
            tell(f"the map is shown at {page.url}")
        yield ViewedRun(page, num_frames)
    finally:
        page.close()
