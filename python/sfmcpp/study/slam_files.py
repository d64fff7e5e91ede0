"""The files of a SLAM run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model import Problem, Trajectory
from sfmcpp.slam.scale_drift import scale_sigmas
from sfmcpp.sources.io.api import write
from sfmcpp.sources.io.checks import fault_of_image_name
from sfmcpp.sources.io.trajectories import write_trajectory
from sfmcpp.study.evaluation import Matched, associate
from sfmcpp.study.pages.scene_page import Scene, save_scene_page
from sfmcpp.study.plotting import save_figure
from sfmcpp.study.plotting.evaluations import plot_scale_ratio, plot_top_view
from sfmcpp.study.plotting.weights import has_curves, plot_trade_off, plot_weights
from sfmcpp.study.report_files import MODEL, POINTS, REPORT, VIEW, Step, write_report, write_steps

if TYPE_CHECKING:
    from sfmcpp.slam import SlamRun
    from sfmcpp.study.slam_report import SlamReport

TRAJECTORY, KEYFRAMES = "trajectory.txt", "keyframes.txt"
TOP_VIEW, WEIGHTS, TRADE_OFF, SCALE = "trajectory.png", "weights.png", "trade_off.png", "scale.png"
FILES = (TRAJECTORY, KEYFRAMES, POINTS, VIEW, REPORT, TOP_VIEW, WEIGHTS, TRADE_OFF, SCALE)
# Counts that the page shows, by what it calls them.
_FACTS = {name: name for name in ("frames", "keyframes", "points", "bridged")} | {"predicted": "lost"}


def write_files(report: SlamReport, folder: Path) -> list[Path]:
    """Write all files of a run, or the report alone if there is no map, also after one fails.

    Raises
    ------
    DatasetError
        If any could not be written.
    """
    return write_steps(_steps(report), folder)


def _steps(report: SlamReport) -> Iterator[Step]:
    run, world = report.run, report.run.world
    if world is not None:
        problem, records = world.whole_problem(min_views=2).problem, run.result.records
        if run.origin is not None:
            run.origin.put_into(problem.metadata)
        trajectory, keyframes = run.trajectory(), run.result.keyframe_trajectory()
        yield TRAJECTORY, partial(write_trajectory, trajectory)
        yield KEYFRAMES, partial(write_trajectory, keyframes)
        yield MODEL, partial(_write_model, colmap_problem(problem, run))
        yield POINTS, partial(write, problem)
        yield TOP_VIEW, partial(_draw_top_view, report, trajectory, problem)
        yield VIEW, lambda path: save_scene_page(_scene(report, trajectory, problem), path)
    yield REPORT, lambda path: write_report(report.to_dict(), path)
    if world is not None:
        start_s = float(keyframes.t_s[0])  # as in the figure of the scale
        if any(record.weights for record in records):
            yield WEIGHTS, lambda path: save_figure(plot_weights(records, start_s=start_s), path)
        if has_curves(records):
            yield TRADE_OFF, lambda path: save_figure(plot_trade_off(records, start_s=start_s), path)
        pairs = _true_keyframes(report, keyframes)
        if pairs is not None:
            yield SCALE, partial(_draw_scale, report, pairs)


def colmap_problem(problem: Problem, run: SlamRun) -> Problem:
    """The problem of all keyframes with the sizes and names of their images, and pixels from the corner.

    COLMAP has the centre of the top left pixel at (0.5, 0.5), OpenCV, which follows corners, at (0, 0).
    """
    frames, world = run.drive.frames, run.world
    result = problem.copy()
    if frames.image_size is not None:
        result.metadata.image_sizes = np.tile(np.array(frames.image_size, np.int64), (problem.num_cameras, 1))
    if world is not None and len(frames.image_names) > 0:
        names = [frames.image_names[keyframe.frame] for keyframe in world.keyframes]
        if all(fault_of_image_name(name) is None for name in names):
            result.metadata.image_names = names
    shift = 0.5 - frames.first_pixel_px
    result.pixels += shift
    result.intrinsics[:, [result.intrinsic_names.index(name) for name in ("cx", "cy")]] += shift
    return result


def _write_model(problem: Problem, folder: Path) -> None:
    for name in ("colmap-text", "colmap-binary"):
        write(problem, folder, format=name)


def _draw_top_view(report: SlamReport, trajectory: Trajectory, problem: Problem, path: Path) -> None:
    """Draw the map from above, in the frame of the first camera, or of the first true one."""
    comparison = report.comparison
    if comparison is None:
        place, truth = _at_first_pose(trajectory), None
    else:
        there = _at_first_pose(comparison.truth)
        place, truth = there @ comparison.alignment.similarity, there.apply(comparison.truth.centres)
    seen = (trajectory.centres, problem.centres, problem.points)
    figure = plot_top_view(
        *map(place.apply, seen),
        truth=truth,
        alignment=report.alignment,
        unit=_unit_of_map(report, truth is not None),
        predicted=_predicted(report),
    )
    save_figure(figure, path)


def _predicted(report: SlamReport) -> list[int]:
    """Places in the trajectory of the frames whose images say too little."""
    result = report.run.result
    lost = set(result.lost)
    return [place for place, frame in enumerate(sorted(result.poses)) if frame in lost]


def _unit_of_map(report: SlamReport, aligned: bool = False) -> str:
    return "m" if aligned or report.run.result.metric else ""


def _at_first_pose(trajectory: Trajectory) -> Similarity:
    """Move the world so that the first camera is at the origin, x right and z ahead."""
    first = trajectory.poses[0]
    return Similarity(1.0, first[:, :3], first[:, 3]).inverse()


def _true_keyframes(report: SlamReport, keyframes: Trajectory) -> Matched | None:
    """Keyframes and their true poses; None if nothing is compared, or the truth knows none of them."""
    truth = report.run.drive.truth
    if truth is None or report.comparison is None:
        return None
    try:
        return associate(keyframes, truth)
    except InvalidArgument:
        return None


def _draw_scale(report: SlamReport, pairs: Matched, path: Path) -> None:
    """A map in metres is measured as it is, any other once it is aligned."""
    comparison, found, result = report.comparison, pairs.estimate, report.run.result
    if result.metric or comparison is None:
        save_figure(plot_scale_ratio(pairs), path)
        return
    scaled = found.with_poses(comparison.alignment.similarity.apply_to_poses(found.poses))
    sigmas = scale_sigmas(result)
    if sigmas is not None:
        sigmas = np.interp(found.t_s, result.keyframe_trajectory().t_s, sigmas)
    figure = plot_scale_ratio(Matched(scaled, pairs.truth), scaled=report.alignment, sigmas=sigmas)
    save_figure(figure, path)


def _scene(report: SlamReport, trajectory: Trajectory, problem: Problem) -> Scene:
    run, comparison = report.run, report.comparison
    scene = Scene(
        run.drive.path.stem,
        problem.points,
        trajectory.centres,
        problem.cameras,
        truth_name="",
        unit=_unit_of_map(report),
        facts={name: f"{run.totals[total]:,}" for name, total in _FACTS.items()},
        predicted=_predicted(report),
        east_north_up=run.origin is not None,
    )
    if comparison is None:
        return scene
    true = comparison.alignment.similarity.inverse().apply(comparison.truth.centres)
    return replace(scene, truth=true, truth_name=f"truth, {report.alignment}")
