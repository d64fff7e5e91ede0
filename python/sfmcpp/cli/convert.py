"""`sfmcpp convert`: problems, positions and trajectories between formats; also on several ranks."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from sfmcpp.ba.parts import ProblemSize
from sfmcpp.ba.ranks import Ranks
from sfmcpp.cli.choices import choice_option
from sfmcpp.cli.console import ExitCode, print_result, with_exit_code
from sfmcpp.cli.georeferencing import Gps, write_camera_positions
from sfmcpp.cli.mpi_launch import launched_ranks, run_on_ranks
from sfmcpp.cli.reading import note_changed, read_with_notes
from sfmcpp.cli.targets import (
    PAGE_SUFFIXES,
    Targets,
    require_writable_file,
    require_writable_problem,
    write_page,
)
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem, Trajectory
from sfmcpp.sources.frame_times import read_times
from sfmcpp.sources.io.alicevision import write_alicevision
from sfmcpp.sources.io.api import format_of, formats, named_format, read, read_part, write, write_part
from sfmcpp.sources.io.conversion_notes import left_out_on_writing
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.openmvg import write_openmvg
from sfmcpp.sources.io.parts import write_parts
from sfmcpp.sources.io.position_files import POSITION_SUFFIXES
from sfmcpp.sources.io.trajectories import WRITABLE_TRAJECTORY_FORMATS, read_trajectory, write_trajectory
from sfmcpp.sources.io.transforms import folder_from, write_transforms

# OpenMVG and Meshroom look for relative paths where they run, and not where the file is.
_WRITERS_WITH_IMAGES: dict[str, Callable[[Problem, Path, Path], None]] = {
    "transforms": lambda problem, path, images: write_transforms(problem, path, folder_from(path, images)),
    "openmvg": lambda problem, path, images: write_openmvg(problem, path, images.absolute().as_posix()),
    "alicevision": lambda problem, path, images: write_alicevision(
        problem, path, images.absolute().as_posix()
    ),
}
_OPEN_IMAGES = "transforms, openmvg and alicevision"
WRITABLE_FORMATS = tuple(known.name for known in formats() if known.writable)


@with_exit_code
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Problem or trajectory to read.")],
    target: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="File to write, or folder for COLMAP. csv, geojson: camera positions. html: a page.",
        ),
    ],
    parts: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Write a folder of N parts, for MPI ranks.")
    ] = None,
    format: Annotated[
        str | None,
        choice_option(
            (*WRITABLE_FORMATS, *WRITABLE_TRAJECTORY_FORMATS),
            "Format of OUT, if its name is ambiguous, or of a trajectory (also of a problem's cameras)",
        ),
    ] = None,
    images: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help=f"Folder of the images, for {_OPEN_IMAGES}."),
    ] = None,
    times: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Time stamps of poses without any, one per line, for tum and euroc."
        ),
    ] = None,
) -> ExitCode:
    """Convert a problem or a trajectory to another format.

    File names determine the formats of problems. Under mpiexec each rank writes one part, and no rank
    holds the whole problem.
    """
    if format in WRITABLE_TRAJECTORY_FORMATS and parts is None and images is None:
        return convert_trajectory(source, target, format, times)
    if times is not None:
        raise InvalidArgument("--times: for trajectories, --format tum or euroc")
    ranks = launched_ranks(asked=False)
    if ranks is not None or parts is not None:
        _require_nothing_for_one_file(format, images)
    if ranks is not None:
        common = {"command": "convert", "INPUT": source, "OUTPUT": target, "--parts": parts}
        return run_on_ranks(ranks, common, lambda heeded: _convert_on_ranks(source, target, parts, ranks))
    plain = parts is None and format is None and images is None
    if plain and target.suffix.lower() in POSITION_SUFFIXES:
        return _convert_to_positions(source, target)
    if plain and target.suffix.lower() in PAGE_SUFFIXES:
        return _convert_to_page(source, target)
    if parts is None:
        return _convert_one(source, target, format, images)
    problem = read_with_notes(source)
    write_parts(problem, target, parts)
    print_result(f"{target}: {problem} in {parts} parts")
    return ExitCode.DONE


def _require_nothing_for_one_file(format: str | None, images: Path | None) -> None:
    if format is not None:
        raise InvalidArgument(f"--format {format}: parts have a format of their own")
    if images is not None:
        raise InvalidArgument(f"--images: parts do not point to images, {_OPEN_IMAGES} do")


def _convert_one(source: Path, target: Path, format: str | None, images: Path | None) -> ExitCode:
    chosen = format_of(target) if format is None else named_format(format)
    if images is not None and chosen.name not in _WRITERS_WITH_IMAGES:
        raise InvalidArgument(f"--images: {chosen.name} does not point to images, {_OPEN_IMAGES} do")
    require_writable_problem(target, chosen)
    problem = _read(source)
    if images is None:
        write(problem, target, format=chosen.name)
    else:
        _WRITERS_WITH_IMAGES[chosen.name](problem, target, images)
    _print_written(problem, target, chosen)
    return ExitCode.DONE


def _read(source: Path) -> Problem:
    try:
        return read_with_notes(source)
    except DatasetError as error:
        refuse_trajectory(source, error)
        raise


def _convert_to_positions(source: Path, target: Path) -> ExitCode:
    targets = Targets(positions=target)
    targets.check(source)
    problem = _read(source)
    targets.check_fits(problem)
    Gps().check_fits(target, problem)
    write_camera_positions(target, problem, None)
    print_result(f"{target}: positions of {problem.num_cameras:,} cameras")
    return ExitCode.DONE


def _convert_to_page(source: Path, target: Path) -> ExitCode:
    targets = Targets(page=target)
    targets.check(source)
    problem = read_with_notes(source)
    targets.check_fits(problem)
    write_page(problem, target, source)
    print_result(
        f"{target}: {problem.num_cameras:,} cameras and {problem.num_points:,} points, for a browser"
    )
    return ExitCode.DONE


def _print_written(problem: Problem, target: Path, chosen: Format) -> None:
    counts = {
        "cameras": problem.num_cameras,
        "points": problem.num_points,
        "observations": problem.num_observations,
    }
    written = [f"{count:,} {name}" for name, count in counts.items() if name not in chosen.lacks]
    print_result(f"{target}: {', '.join(written)} ({chosen.name})")
    if left_out := left_out_on_writing(problem, chosen):
        print_result(f"left out, as {chosen.name} has no place for it: {', '.join(left_out)}")
    note_changed(problem, target, chosen)


def _convert_on_ranks(source: Path, target: Path, parts: int | None, ranks: Ranks) -> ExitCode:
    if parts not in (None, ranks.size):
        raise InvalidArgument(f"--parts {parts}: {ranks.size} ranks write one part each")
    ranks.from_root(lambda: require_writable_problem(target))
    part = read_part(source, ranks)
    write_part(part, target, ranks)
    size = ProblemSize.of(part.problem, ranks)
    if ranks.is_root:
        print_result(
            f"{target}: {size.num_points} points, {size.num_observations} observations in {ranks.size} parts"
        )
    return ExitCode.DONE


def convert_trajectory(source: Path, target: Path, format: str, times: Path | None) -> ExitCode:
    """Write a trajectory in another format, or the poses of a problem as one.

    Poses stay as they are, of the camera or of the body; those of a problem are in the order of its cameras.

    Raises
    ------
    DatasetError
        If a file cannot be read or written, or would replace that of the times; if the format needs times,
        and there are none, or there are and others are given; if cameras have no poses.
    """
    require_writable_file(target)
    if times is not None and os.path.realpath(times) == os.path.realpath(target):
        raise DatasetError(target, "is named twice: the file of times must not be replaced")
    trajectory = _trajectory_of(source)
    if times is not None:
        trajectory = _interpolated_at(trajectory, source, times)
    if format != "kitti" and not trajectory.stamped:
        raise DatasetError(source, f"has no times, which {format} needs: --times FILE, a line for each pose")
    write_trajectory(trajectory, target, format=format)
    print_result(f"{target}: {len(trajectory):,} poses ({format})")
    if trajectory.stamped and format == "kitti":
        print_result("left out, as kitti has no place for it: times")
    return ExitCode.DONE


def _trajectory_of(source: Path) -> Trajectory:
    """Read a trajectory, or the poses of a problem."""
    try:
        return read_trajectory(source)
    except DatasetError as no_trajectory:
        try:
            problem = read(source)
        except DatasetError:
            raise no_trajectory from None
    if not (problem.is_metric and problem.num_cameras):
        raise DatasetError(source, f"its {problem.num_cameras} {problem.camera_model} cameras have no poses")
    return Trajectory(np.arange(problem.num_cameras), problem.cameras, stamped=False)


def refuse_trajectory(source: Path, error: DatasetError) -> None:
    """Raise a better error where a file that is no problem is a trajectory."""
    try:
        found = read_trajectory(source)
    except DatasetError:
        return
    known = ", ".join(WRITABLE_TRAJECTORY_FORMATS)
    reason = f"is a trajectory of {len(found):,} poses: --format says what to make of it: {known}"
    raise DatasetError(source, reason) from error


def _interpolated_at(trajectory: Trajectory, source: Path, times: Path) -> Trajectory:
    if trajectory.stamped:
        raise DatasetError(source, "has times of its own: --times is for poses without any")

    def require_fit(count: int) -> None:
        if count != len(trajectory):
            raise DatasetError(times, f"holds {count} times for {len(trajectory)} poses: must be as many")

    return Trajectory(read_times(times, require_fit), trajectory.poses)
