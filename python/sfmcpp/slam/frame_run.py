"""A SLAM run over the frames of a source: the loop, a callback, checkpoints."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence

from sfmcpp.ba.adjust import continues_after
from sfmcpp.ba.checkpoints import CheckpointStore
from sfmcpp.model.frames import Frame
from sfmcpp.slam.checkpoints import SlamCheckpoints
from sfmcpp.slam.measurement import MotionSensor
from sfmcpp.slam.motion_sensors import Gyroscope
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.slam import Slam
from sfmcpp.sources.frames import FrameSource

Listener = Callable[[int, SlamResult], object]
# Once with a wrong mounting corrected, once without what images deny even then.
_MOST_RESTARTS = 2


def run_slam(
    source: FrameSource,
    settings: SlamSettings | None = None,
    sensors: Sequence[MotionSensor] = (),
    callback: Listener | None = None,
    checkpoint: CheckpointStore | None = None,
    resume: CheckpointStore | None = None,
) -> SlamResult:
    """Run over all frames of a source.

    If the run finds a sensor wrong (its clock, a bias, its measurements for a while), that has bent the map
    by then: it is begun again with corrected sensors. The second run is kept if it finds nothing wrong any
    more, and warnings say so. After a wrong mounting, what is wrong even then is corrected by a third.

    Parameters
    ----------
    source : FrameSource
        What the camera sees; each frame is asked for once, when the one before is done.
    settings : SlamSettings, optional
        What decides about keyframes, poses and points; `hindsight` whether a run may be begun again.
    sensors : sequence of MotionSensor
        What measures the motion beside the camera.
    callback : callable, optional
        Called as ``callback(frame, result)`` after each frame, with its number; the run ends where it returns
        False, as a solve does. In a run that is begun again, too: that ends it, and leaves the first one.
    checkpoint : CheckpointFolder, optional
        Where to save, from time to time, where the callback ends the run and after the last frame, what a
        later call needs to go on. If that fails once the run goes, it goes on, and a warning of the result
        names the file.
    resume : CheckpointFolder, optional
        Where an earlier call with the same arguments saved checkpoints: this one goes on behind the last
        frame that it took, and the result has the bits of one call, times aside. Images up to there are
        followed anew; the callback hears of the frames after it.

    Returns
    -------
    SlamResult
        The map and the poses; `message` says why if there is no map.

    Raises
    ------
    DatasetError
        If `checkpoint` cannot be written or holds checkpoints of an earlier run; if `resume` has no whole
        checkpoint, or one of other frames, sensors, settings, of another version or instruction set.
    """
    slam = Slam(source.intrinsics, settings, sensors)
    checkpoints = SlamCheckpoints(checkpoint, resume, source, slam.settings, sensors, slam.state())
    passes = _Passes(source, callback, checkpoints, kept=bool(sensors))
    if passes.take(slam):
        slam = _repeated_with_corrections(slam, sensors, source, passes)
    slam.result.seconds = passes.seconds
    slam.result.warnings += checkpoints.warnings
    return slam.result


def ends_run(callback: Listener | None, frame: int, result: SlamResult) -> bool:
    """Tell a callback of a frame; whether it ends the run."""
    return callback is not None and not continues_after(callback(frame, result))


class _Passes:
    """Passes over the same frames, each by a loop of its own; those of a saved run are taken up.

    Frames are read from the source once, and where a second pass may come are `kept` for it.
    """

    def __init__(
        self, source: FrameSource, callback: Listener | None, checkpoints: SlamCheckpoints, *, kept: bool
    ) -> None:
        self._frames: Iterable[Frame] = source
        self._callback, self._checkpoints, self._kept = callback, checkpoints, kept
        self._begin_s = time.perf_counter()

    @property
    def seconds(self) -> float:
        """What all passes have taken so far, with those of the saved run [s]."""
        return time.perf_counter() - self._begin_s

    def take(self, slam: Slam) -> bool:
        """Take all frames and finish; False if the callback ends it before."""
        checkpoints = self._checkpoints
        state = checkpoints.begin_pass(slam.state)
        if state is not None:
            slam.restore(state)
            self._begin_s = time.perf_counter() - slam.result.seconds
        seen: list[Frame] = []
        last: Frame | None = None
        for frame in self._frames:
            last = frame
            if self._kept:
                seen.append(frame)
            if not checkpoints.has_passed(frame) and self._ends(slam, frame):
                return False
        self._frames = seen
        if not checkpoints.has_finished:
            if last is not None:  # what follows may take as long as the frames
                checkpoints.offer(last, True)
            slam.finish()
        return True

    def _ends(self, slam: Slam, frame: Frame) -> bool:
        """Take a frame; whether the callback ends the run there."""
        slam.step(frame)
        slam.result.seconds = self.seconds
        ended = ends_run(self._callback, frame.number, slam.result)
        self._checkpoints.offer(frame, ended)
        return ended


def _repeated_with_corrections(
    slam: Slam, given: Sequence[MotionSensor], source: FrameSource, passes: _Passes
) -> Slam:
    """The run once more with corrected sensors, if it has found anything wrong; twice after a wrong mounting.

    That is kept if it finds nothing wrong any more; otherwise the images were wrong, as on a motorway. But no
    images turn all directions of travel: a run with a wrong mounting is never kept beside one without, nor is
    one without a map.
    """
    kept, sensors = slam, _better_sensors(slam, given) if slam.settings.hindsight else None
    for _ in range(_MOST_RESTARTS):
        if sensors is None:
            break
        again = Slam(source.intrinsics, slam.settings, sensors)
        if not passes.take(again) or again.result.world is None:
            return kept
        sensors = again.in_hindsight()
        if sensors is not None and not kept.has_wrong_mounting and kept.result.world is not None:
            break
        # Of a run that finds nothing, they are of samples that the corrections took away.
        more = [] if sensors is None else again.result.warnings
        first = kept.result.warnings + _doubt_of_start(kept.result, given)
        again.result.warnings = _warnings_of_both(first, more)
        kept = again
    if sensors is not None:
        kept.result.warnings.append("a run without what was wrong found more, and was not kept")
    return kept


def _better_sensors(slam: Slam, given: Sequence[MotionSensor]) -> tuple[MotionSensor, ...] | None:
    """What a run should have had; where no map was started, no gyroscope, by whose turns it was to start."""
    if slam.result.world is not None:
        return slam.in_hindsight()
    others = tuple(sensor for sensor in given if not isinstance(sensor, Gyroscope))
    return others if len(others) < len(given) else None


def _doubt_of_start(result: SlamResult, given: Sequence[MotionSensor]) -> list[str]:
    """What is told of a run without a map, if one without gyroscopes has one."""
    gyros = " and ".join(sensor.name for sensor in given if isinstance(sensor, Gyroscope))
    told = f"{gyros}: no map can be started with it, but without: check its axes, unit and clock"
    return [told] if result.world is None else []


def _warnings_of_both(first: list[str], second: list[str]) -> list[str]:
    """Those of a run and what is new in the next's; last, that there was a next."""
    begun = "the run was begun again without what was wrong"
    told = [warning for warning in first if warning != begun]
    return [*told, *(warning for warning in second if warning not in told), begun]
