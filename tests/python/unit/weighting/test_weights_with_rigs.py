"""Weights of constraints on cameras of rigs: what moves with them counts as they do."""

from __future__ import annotations

import numpy as np

import sfmcpp
from sfmcpp import ConstraintGroup, Problem
from sfmcpp.model.arrays import BoolArray

SIGMA_M = 0.05


def walk(free: int, unobserved: int | None = None) -> Problem:
    """A rig of three cameras of which one is free, and off by centimetres; another may see nothing."""
    truth = sfmcpp.rig_walk_scene(pixel_sigma_px=0.5, seed=0)
    assert truth.rigs is not None
    keep = truth.rigs.sensor_of_camera[truth.camera_index] != (-1 if unobserved is None else unobserved)
    problem = truth.with_observations(keep)
    problem.rigs = truth.rigs.copy()
    problem.rigs.free_sensors = np.arange(3) == free
    problem.rigs.sensors[free, :, 3] += [0.02, -0.01, 0.03]
    problem.cameras[:] = problem.rigs.rigid(problem.cameras)
    return problem


def positions(cameras: BoolArray, seed: int = 0) -> ConstraintGroup:
    """Where these cameras are, to within `SIGMA_M`."""
    truth = sfmcpp.rig_walk_scene(pixel_sigma_px=0.5, seed=0)
    which = np.flatnonzero(cameras).astype(np.int32)
    noise = SIGMA_M * np.random.default_rng(seed).standard_normal((len(which), 3))
    return ConstraintGroup("position", which, truth.cameras[which, :, 3] + noise, name="gps")


def test_positions_of_a_camera_that_sees_nothing_are_weighed() -> None:
    """An antenna is such a camera: its frame moves with the images of the others."""
    problem = walk(free=1, unobserved=0)
    assert problem.rigs is not None
    group = positions(problem.rigs.sensor_of_camera == 0)
    (chosen,) = sfmcpp.solve(problem, constraints=[group], weight="variance").group_weights
    assert SIGMA_M / 1.5 < chosen.sensor_sigma < 1.5 * SIGMA_M


def test_positions_of_a_free_camera_on_frames_that_are_fixed_are_weighed() -> None:
    problem = walk(free=1)
    assert problem.rigs is not None
    is_free = problem.rigs.sensor_of_camera == 1
    problem.fixed_cameras[:] = True
    (chosen,) = sfmcpp.solve(problem, constraints=[positions(is_free)], weight="variance").group_weights
    assert SIGMA_M / 1.5 < chosen.sensor_sigma < 1.5 * SIGMA_M
