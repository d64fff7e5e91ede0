"""The files of a SLAM run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sfmcpp.cli.report import write_report
from sfmcpp.cli.slam_input import SlamInput
from sfmcpp.cli.slam_job import Measured, SlamJob
from sfmcpp.cli.slam_report import ALIGNMENTS, compare, make_report, totals
from sfmcpp.errors import DatasetError
from sfmcpp.evaluation import Evaluation
from sfmcpp.io.api import write
from sfmcpp.io.trajectories import write_trajectory
from sfmcpp.model import Problem, Similarity, Trajectory
from sfmcpp.slam import KeyframeRecord
from sfmcpp.slam.export import problem_of

REPORT = "report.json"


def require_pictures(folder: Path) -> None:
    """Raise a DatasetError if no picture can be drawn."""
    try:
        import sfmcpp.plotting  # noqa: F401
    except ModuleNotFoundError as error:
        reason = f"its trajectory.png needs {error.name}: pip install 'sfmcpp[plot]'"
        raise DatasetError(folder, reason) from None


def write_report_of(
    job: SlamJob, given: SlamInput, measured: Measured, comparison: Evaluation | None = None
) -> None:
    """Write the report alone."""
    write_report(make_report(job, given, measured, comparison), job.output / REPORT)


def write_results(
    job: SlamJob, given: SlamInput, measured: Measured
) -> tuple[Evaluation | None, list[Path], list[DatasetError]]:
    """Write all files of a run that has a map, and go on where one fails.

    Returns
    -------
    comparison : Evaluation or None
        With the truth, where the input knows it.
    written : list of Path
        What was written.
    complaints : list of DatasetError
        What could not be.
    """
    world = measured.result.world
    assert world is not None
    problem = problem_of(world)
    trajectory = measured.result.trajectory(given.sequence.t_s)
    keyframes = measured.result.keyframe_trajectory()
    comparison = compare(trajectory, given.truth)
    steps: dict[str, Callable[[Path], None]] = {
        "trajectory.txt": lambda path: write_trajectory(trajectory, path),
        "keyframes.txt": lambda path: write_trajectory(keyframes, path),
        "model": lambda path: _write_model(problem, path),
        "points.ply": lambda path: write(problem, path),
        "trajectory.png": lambda path: _draw(trajectory, problem, comparison, path),
        "view.html": lambda path: _write_page(job, trajectory, problem, measured, comparison, path),
        REPORT: lambda path: write_report(make_report(job, given, measured, comparison), path),
    }
    records = measured.result.records
    if any(record.weights for record in records):
        steps["weights.png"] = lambda path: _draw_weights(records, path)
    written, complaints = [], []
    for name, step in steps.items():
        try:
            step(job.output / name)
            written.append(job.output / name)
        except DatasetError as error:
            complaints.append(error)
    return comparison, written, complaints


def _write_model(problem: Problem, folder: Path) -> None:
    for name in ("colmap-text", "colmap-binary"):
        write(problem, folder, format=name)


def _draw(trajectory: Trajectory, problem: Problem, comparison: Evaluation | None, path: Path) -> None:
    from sfmcpp.plotting import save_figure
    from sfmcpp.plotting.top_view import plot_top_view

    centres, keyframes, points = trajectory.centres, problem.centres, problem.points
    if comparison is None:
        save_figure(plot_top_view(centres, keyframes, points), path)
        return
    truth = _at_first_pose(comparison.truth)
    place = truth @ comparison.alignment.similarity
    figure = plot_top_view(
        place.apply(centres),
        place.apply(keyframes),
        place.apply(points),
        truth=truth.apply(comparison.truth.centres),
        alignment=ALIGNMENTS[str(comparison.alignment.rule)],
        unit="m",
    )
    save_figure(figure, path)


def _draw_weights(records: list[KeyframeRecord], path: Path) -> None:
    from sfmcpp.plotting import save_figure
    from sfmcpp.plotting.weights import plot_weights

    save_figure(plot_weights(records), path)


def _at_first_pose(truth: Trajectory) -> Similarity:
    """Move the world so that the first true camera is at the origin, x right and z ahead."""
    first = truth.poses[0]
    return Similarity(1.0, first[:, :3], first[:, 3]).inverse()


def _write_page(
    job: SlamJob,
    trajectory: Trajectory,
    problem: Problem,
    measured: Measured,
    comparison: Evaluation | None,
    path: Path,
) -> None:
    from sfmcpp.plotting.scene_page import Scene, save_scene_page

    count = totals(measured)
    names = ("frames", "keyframes", "points", "bridged", "lost")
    truth, name = np.empty((0, 3)), ""
    if comparison is not None:
        truth = comparison.alignment.similarity.inverse().apply(comparison.truth.centres)
        name = f"truth, {ALIGNMENTS[str(comparison.alignment.rule)]}"
    scene = Scene(
        job.source.stem,
        problem.points,
        trajectory.centres,
        problem.cameras,
        truth,
        name,
        facts={name: f"{count[name]:,}" for name in names},
    )
    save_scene_page(scene, path)
