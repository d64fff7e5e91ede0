"""The files of a SLAM run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sfmcpp.cli.report import write_report
from sfmcpp.cli.slam_input import SlamInput
from sfmcpp.cli.slam_job import Measured, SlamJob
from sfmcpp.cli.slam_report import ALIGNMENTS, compare, make_report, totals
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model import Problem, Trajectory
from sfmcpp.slam import KeyframeRecord
from sfmcpp.sources.io.api import write
from sfmcpp.sources.io.trajectories import write_trajectory
from sfmcpp.study.evaluation import Alignment, Evaluation, Matched, associate

REPORT = "report.json"


def require_pictures(folder: Path) -> None:
    """Raise a DatasetError if no picture can be drawn."""
    try:
        import sfmcpp.study.plotting  # noqa: F401
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
    problem = world.whole_problem(min_views=2).problem
    trajectory = measured.result.trajectory()
    keyframes = measured.result.keyframe_trajectory()
    comparison = compare(trajectory, given.truth)
    unit = "m" if measured.result.metric else ""
    steps: dict[str, Callable[[Path], None]] = {
        "trajectory.txt": lambda path: write_trajectory(trajectory, path),
        "keyframes.txt": lambda path: write_trajectory(keyframes, path),
        "model": lambda path: _write_model(problem, path),
        "points.ply": lambda path: write(problem, path),
        "trajectory.png": lambda path: _draw(trajectory, problem, unit, comparison, path),
        "view.html": lambda path: _write_page(job, trajectory, problem, measured, comparison, path),
        REPORT: lambda path: write_report(make_report(job, given, measured, comparison), path),
    }
    steps |= _pictures(given, measured, comparison)
    written, complaints = [], []
    for name, step in steps.items():
        try:
            step(job.output / name)
            written.append(job.output / name)
        except DatasetError as error:
            complaints.append(error)
    return comparison, written, complaints


def _pictures(
    given: SlamInput, measured: Measured, comparison: Evaluation | None
) -> dict[str, Callable[[Path], None]]:
    """Pictures of a run with sensors, and of one with a truth."""
    from sfmcpp.study.plotting.trade_off import has_curves

    records = measured.result.records
    steps: dict[str, Callable[[Path], None]] = {}
    if any(record.weights for record in records):
        steps["weights.png"] = lambda path: _draw_weights(records, path)
    if has_curves(records):
        steps["trade_off.png"] = lambda path: _draw_trade_off(records, path)
    pairs = _true_keyframes(given, measured)
    if comparison is not None and pairs is not None:
        alignment = None if measured.result.metric else comparison.alignment
        steps["scale.png"] = lambda path: _draw_scale(pairs, alignment, path)
    return steps


def _true_keyframes(given: SlamInput, measured: Measured) -> Matched | None:
    """Keyframes and their true poses; None without truth, or if it knows none of them."""
    if given.truth is None:
        return None
    try:
        return associate(measured.result.keyframe_trajectory(), given.truth)
    except InvalidArgument:
        return None


def _write_model(problem: Problem, folder: Path) -> None:
    for name in ("colmap-text", "colmap-binary"):
        write(problem, folder, format=name)


def _draw(
    trajectory: Trajectory, problem: Problem, unit: str, comparison: Evaluation | None, path: Path
) -> None:
    from sfmcpp.study.plotting import save_figure
    from sfmcpp.study.plotting.top_view import plot_top_view

    centres, keyframes, points = trajectory.centres, problem.centres, problem.points
    if comparison is None:
        place = _at_first_pose(trajectory)
        figure = plot_top_view(*map(place.apply, (centres, keyframes, points)), unit=unit)
        save_figure(figure, path)
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
    from sfmcpp.study.plotting import save_figure
    from sfmcpp.study.plotting.weights import plot_weights

    save_figure(plot_weights(records), path)


def _draw_trade_off(records: list[KeyframeRecord], path: Path) -> None:
    from sfmcpp.study.plotting import save_figure
    from sfmcpp.study.plotting.trade_off import plot_trade_off

    save_figure(plot_trade_off(records), path)


def _draw_scale(pairs: Matched, alignment: Alignment | None, path: Path) -> None:
    """A map in metres is measured as it is, any other once it is aligned."""
    from sfmcpp.study.plotting import save_figure
    from sfmcpp.study.plotting.scale_ratio import plot_scale_ratio

    if alignment is None:
        save_figure(plot_scale_ratio(pairs), path)
        return
    found = pairs.estimate
    scaled = Trajectory(found.t_s, alignment.similarity.apply_to_poses(found.poses), found.stamped)
    rule = ALIGNMENTS[str(alignment.rule)]
    save_figure(plot_scale_ratio(Matched(scaled, pairs.truth), scaled=rule), path)


def _at_first_pose(trajectory: Trajectory) -> Similarity:
    """Move the world so that the first camera is at the origin, x right and z ahead."""
    first = trajectory.poses[0]
    return Similarity(1.0, first[:, :3], first[:, 3]).inverse()


def _write_page(
    job: SlamJob,
    trajectory: Trajectory,
    problem: Problem,
    measured: Measured,
    comparison: Evaluation | None,
    path: Path,
) -> None:
    from sfmcpp.study.plotting.scene_page import Scene, save_scene_page

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
        "m" if measured.result.metric else "",
        facts={name: f"{count[name]:,}" for name in names},
    )
    save_scene_page(scene, path)
