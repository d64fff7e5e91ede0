"""Starts within SLAM: the last keyframes before their local adjustment, a whole map before its global one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import sfmcpp
from experiments.description import Experiment, Row
from experiments.inputs import sequence_of
from experiments.real_problems import data_folder
from experiments.starts import Start
from sfmcpp import Problem
from sfmcpp.geometry import triangulate_linear
from sfmcpp.slam import SlamSettings, run_slam
from sfmcpp.slam.mapping import hold_gauge
from sfmcpp.slam.world_map import WorldMap
from sfmcpp.sources.io.kitti_mat import read_kitti_mat


def keyframe_starts(experiment: Experiment) -> Iterator[Start]:
    """Each entry of ``settings.keyframes``, a `name`, a `file` of a drive and how many of the `last` move.

    Where these are fewer than all, the newest has been resected and has not been adjusted yet.
    """
    worlds: dict[str, WorldMap] = {}
    for item in experiment.settings.get("keyframes", []):
        file = item["file"]
        if file not in worlds:
            worlds[file] = _world(file)
        yield Start(item["name"], 0, _problem(worlds[file], item))


def _world(file: str) -> WorldMap:
    world = run_slam(sequence_of(read_kitti_mat(data_folder() / file)), SlamSettings(), []).world
    assert world is not None
    return world


def _problem(world: WorldMap, item: Row) -> Problem:
    local = world.around(item.get("last", world.num_images))
    hold_gauge(local, 2)
    if "last" in item:
        _resect_newest(local.problem)
    return local.problem


def _resect_newest(problem: Problem) -> None:
    """Put the newest camera where the points of the others see it, and the points where these cameras do."""
    newest = problem.num_cameras - 1
    others = problem.camera_index != newest
    views = np.bincount(problem.point_index[others], minlength=problem.num_points)
    older = others & (views >= 2)[problem.point_index]
    fitted = problem.copy()
    fitted.points[:] = _triangulated(problem, older)
    known = np.isfinite(fitted.points[:, 0])
    rows = np.flatnonzero(known[problem.point_index] & ~others)
    fitted = _with_rows(fitted, rows)
    fitted.points[~known] = 0.0
    fitted.fixed_points[:] = True
    fitted.fixed_cameras[:] = np.arange(problem.num_cameras) != newest
    sfmcpp.solve(fitted, loss="huber", loss_scale_px=2.0, threads=1)
    problem.cameras[newest] = fitted.cameras[newest]
    everything = _triangulated(problem, np.ones(problem.num_observations, dtype=np.bool_))
    problem.points[:] = np.where(known[:, None], _triangulated(problem, older), everything)


def _triangulated(problem: Problem, rows: np.ndarray) -> np.ndarray:
    return triangulate_linear(_with_rows(problem, np.flatnonzero(rows)))


def _with_rows(problem: Problem, rows: np.ndarray) -> Problem:
    result = problem.copy()
    result.camera_index, result.point_index = problem.camera_index[rows], problem.point_index[rows]
    result.pixels = problem.pixels[rows]
    return result
