"""`sfmcpp convert` of trajectories: TUM, KITTI, EuRoC and the truth of KITTI drives."""

from __future__ import annotations

from pathlib import Path

from sfmcpp.cli.exit_codes import ExitCode, say
from sfmcpp.cli.targets import require_writable_file
from sfmcpp.errors import DatasetError
from sfmcpp.model import Trajectory
from sfmcpp.sources.frame_times import read_times
from sfmcpp.sources.io.trajectories import WRITABLE_TRAJECTORY_FORMATS, read_trajectory, write_trajectory


def convert_trajectory(source: Path, target: Path, format: str, times: Path | None) -> ExitCode:
    """Write a trajectory in another format; poses stay as they are, of the camera or of the body.

    Raises
    ------
    DatasetError
        If a file cannot be read or written; if the format needs times, and there are none, or there are
        and others are given.
    """
    require_writable_file(target)
    trajectory = read_trajectory(source)
    if times is not None:
        trajectory = _at_times(trajectory, source, times)
    if format != "kitti" and not trajectory.stamped:
        raise DatasetError(source, f"has no times, which {format} needs: --times FILE, a line for each pose")
    write_trajectory(trajectory, target, format=format)
    say(f"{target}: {len(trajectory):,} poses ({format})")
    if trajectory.stamped and format == "kitti":
        say("left out, as kitti has no place for it: times")
    return ExitCode.DONE


def refuse_trajectory(source: Path, error: DatasetError) -> None:
    """Raise a better error where a file that is no problem is a trajectory."""
    try:
        found = read_trajectory(source)
    except DatasetError:
        return
    known = ", ".join(WRITABLE_TRAJECTORY_FORMATS)
    reason = f"is a trajectory of {len(found):,} poses: --format says what to make of it: {known}"
    raise DatasetError(source, reason) from error


def _at_times(trajectory: Trajectory, source: Path, times: Path) -> Trajectory:
    if trajectory.stamped:
        raise DatasetError(source, "has times of its own: --times is for poses without any")

    def require_fit(count: int) -> None:
        if count != len(trajectory):
            raise DatasetError(times, f"holds {count} times for {len(trajectory)} poses: must be as many")

    return Trajectory(read_times(times, require_fit), trajectory.poses)
