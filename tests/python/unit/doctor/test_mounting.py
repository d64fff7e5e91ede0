"""Rigs under examination: two cameras that look to the left and to the right of where the rig goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import sfmcpp
from faults import halves
from sfmcpp import Problem, Rigs
from sfmcpp.doctor import repair
from sfmcpp.doctor.solution import depth_reversed
from sfmcpp.model.rigs import composed

FRAMES, POINTS, FOCAL, SIZE = 12, 400, 600.0, (640, 480)


def turned(axis: int, angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations (n, 3, 3) about one axis of the world."""
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    turns = np.tile(np.eye(3), (len(angles_rad), 1, 1))
    turns[:, i, i] = turns[:, j, j] = np.cos(angles_rad)
    turns[:, j, i] = np.sin(angles_rad)
    turns[:, i, j] = -turns[:, j, i]
    return turns


def rig(*, turns: bool, looks_apart: bool = True, free: bool = True) -> Problem:
    """A rig that goes along z, straight ahead or turning about two axes."""
    rng = np.random.default_rng(0)
    frames, steps = np.tile(np.eye(3, 4), (FRAMES, 1, 1)), np.arange(FRAMES)
    frames[:, 2, 3] = 0.5 * steps
    if turns:
        frames[:, :, :3] = turned(1, 0.2 * np.sin(steps)) @ turned(0, 0.1 * steps)
    sensors = np.tile(np.eye(3, 4), (2, 1, 1))
    sensors[:, :, :3] = turned(1, np.pi / 2 * np.array([1.0, -1.0 if looks_apart else 1.0]))
    sensors[1, :, 3] = [-0.3, 0.0, 0.05]
    rigs = Rigs(sensors, np.repeat(steps, 2), np.tile([0, 1], FRAMES), np.array([False, free]))
    cameras = composed(frames[rigs.frame_of_camera], sensors[rigs.sensor_of_camera])
    sides = np.where(np.arange(POINTS) % 2, 1.0, -1.0)
    points = np.column_stack(
        [sides * rng.uniform(4, 8, POINTS), rng.uniform(-2, 2, POINTS), rng.uniform(-3, 9, POINTS)]
    )
    camera, point = np.divmod(np.arange(2 * FRAMES * POINTS), POINTS)
    seen = np.einsum("mji,mj->mi", cameras[camera, :, :3], points[point] - cameras[camera, :, 3])
    pixels = FOCAL * seen[:, :2] / seen[:, 2:] + np.array(SIZE) / 2
    inside = (seen[:, 2] > 0.5) & (pixels > 0).all(axis=1) & (pixels < SIZE).all(axis=1)
    problem = Problem(
        "calibrated",
        cameras,
        np.array([[FOCAL, 1.0, SIZE[0] / 2, SIZE[1] / 2, 0.0]]),
        points,
        camera[inside],
        point[inside],
        pixels[inside] + rng.normal(0, 0.3, (np.count_nonzero(inside), 2)),
        intrinsics_index=np.zeros(2 * FRAMES, np.int32),
    )
    problem.rigs = rigs
    return problem


def test_a_free_sensor_that_nothing_tells_is_named() -> None:
    (finding,) = [f for f in sfmcpp.diagnose(rig(turns=False)).findings if f.severity != "note"]
    assert finding.code == "undetermined-sensors"
    assert "(sensor 1)" in str(finding)
    assert finding.cameras == tuple(range(1, 2 * FRAMES, 2))


@pytest.mark.parametrize(
    "problem",
    [rig(turns=True), rig(turns=False, looks_apart=False), rig(turns=False, free=False)],
    ids=["turns", "sees in common", "held"],
)
def test_sensors_that_the_data_tell_raise_no_alarm(problem: Problem) -> None:
    found = sfmcpp.diagnose(problem)
    assert found.is_healthy, str(found)
    assert not found.skipped


@pytest.mark.parametrize("turns", [False, True], ids=["straight", "turning"])
def test_the_only_sensor_of_frames_that_are_fixed_is_examined_too(turns: bool) -> None:
    hand = rig(turns=turns).with_cameras(np.arange(0, 2 * FRAMES, 2))
    assert hand.rigs is not None
    hand.rigs.free_sensors[:] = True
    hand.fixed_cameras[:] = True
    codes = [finding.code for finding in sfmcpp.diagnose(hand).findings]
    assert ("undetermined-sensors" in codes) is not turns, codes


def test_of_two_free_sensors_the_one_that_nothing_tells_is_named() -> None:
    problem = rig(turns=False)
    assert problem.rigs is not None
    third = problem.rigs.sensors[:1].copy()
    third[0, 1, 3] = 0.2
    beside = np.tile(np.eye(3, 4), (FRAMES, 1, 1))
    beside[:, 1, 3] = 0.2
    cameras = composed(problem.cameras[::2], beside)
    first = problem.camera_index % 2 == 0
    seen_by = 2 * FRAMES + problem.camera_index[first] // 2
    offsets = problem.points[problem.point_index[first]] - cameras[seen_by - 2 * FRAMES, :, 3]
    seen = np.einsum("mji,mj->mi", cameras[seen_by - 2 * FRAMES, :, :3], offsets)
    three = Problem(
        "calibrated",
        np.concatenate([problem.cameras, cameras]),
        problem.intrinsics,
        problem.points,
        np.concatenate([problem.camera_index, seen_by]),
        np.concatenate([problem.point_index, problem.point_index[first]]),
        np.concatenate([problem.pixels, FOCAL * seen[:, :2] / seen[:, 2:] + np.array(SIZE) / 2]),
        intrinsics_index=np.zeros(3 * FRAMES, np.int32),
    )
    three.rigs = Rigs(
        np.concatenate([problem.rigs.sensors, third]),
        np.concatenate([problem.rigs.frame_of_camera, np.arange(FRAMES)]),
        np.concatenate([problem.rigs.sensor_of_camera, np.full(FRAMES, 2)]),
        np.array([False, True, True]),
    )
    (finding,) = [f for f in sfmcpp.diagnose(three).findings if f.severity == "warning"]
    assert finding.code == "undetermined-sensors"
    assert "(sensor 1)" in str(finding)


def test_cameras_of_a_frame_are_of_one_part_and_nothing_of_a_rig_is_dropped() -> None:
    problem = rig(turns=False, free=False)
    assert repair(problem).problem.num_observations == problem.num_observations


def test_a_weak_camera_that_is_alone_in_its_frame_is_named() -> None:
    problem = sfmcpp.circle_scene(8, 60, pixel_sigma_px=0.5, seed=3)
    few = np.flatnonzero(problem.camera_index == 4)[4:]
    problem = problem.with_observations(np.delete(np.arange(problem.num_observations), few))
    assert "weak-cameras" in sfmcpp.diagnose(problem).codes
    problem.rigs = Rigs(np.eye(3, 4)[None], np.arange(8), np.zeros(8, np.int32))
    assert "weak-cameras" in sfmcpp.diagnose(problem).codes
    problem.rigs = Rigs(np.tile(np.eye(3, 4), (2, 1, 1)), [0, 1, 2, 3, 4, 4, 5, 6], [0, 0, 0, 0, 0, 1, 0, 0])
    problem.cameras[:] = problem.rigs.rigid(problem.cameras)
    assert "weak-cameras" not in sfmcpp.diagnose(problem).codes


def test_frames_on_either_side_of_a_weak_link_do_not_hold_it() -> None:
    problem = halves(sfmcpp.circle_scene(8, 60, pixel_sigma_px=0.5, seed=3), 2)
    assert "weak-link" in sfmcpp.diagnose(problem).codes
    sensors = np.tile(np.eye(3, 4), (2, 1, 1))
    for frames, is_found in (([0, 0, 1, 1, 2, 2, 3, 3], True), ([0, 1, 2, 3, 3, 2, 1, 0], False)):
        rigs = Rigs(sensors, frames, [0, 1, 0, 1, 0, 1, 0, 1] if is_found else [0, 0, 0, 0, 1, 1, 1, 1])
        tied = replace(problem, rigs=rigs, cameras=rigs.rigid(problem.cameras))
        assert ("weak-link" in sfmcpp.diagnose(tied).codes) == is_found


def test_intrinsics_are_examined_beside_a_sensor_that_nothing_tells() -> None:
    problem = rig(turns=False)
    problem = Problem(
        "perspective",
        problem.cameras,
        np.pad(np.repeat(problem.intrinsics, 2, axis=0), ((0, 0), (0, 7))),
        problem.points,
        problem.camera_index,
        problem.point_index,
        problem.pixels,
        intrinsics_index=np.tile(np.array([0, 1], np.int32), FRAMES),
        rigs=problem.rigs,
    ).set_free_intrinsics("f", "k1")
    found = sfmcpp.diagnose(problem)
    assert "undetermined-sensors" in found.codes
    assert not found.skipped


def test_minima_near_a_solution_with_rigs_are_looked_for() -> None:
    problem = sfmcpp.rig_walk_scene(24, 1500, seed=0)
    summary = sfmcpp.solve(problem)
    assert not sfmcpp.diagnose(problem, summary=summary).skipped
    inside_out = depth_reversed(problem)
    assert inside_out.rigs is not None
    assert np.abs(inside_out.rigs.rigid(inside_out.cameras) - inside_out.cameras).max() < 1e-9


@pytest.mark.parametrize("freedoms", [6, 7])
def test_the_least_certain_camera_is_that_in_the_frame_of_the_cameras(freedoms: int) -> None:
    problem = sfmcpp.rig_walk_scene(24, 1500, seed=0)
    if freedoms == 7:
        problem.rigs = None
    summary = sfmcpp.solve(problem)
    of_centres = sfmcpp.linearize(problem).covariance(cameras="all").cameras[:, 3:6, 3:6]
    count, points = 2 * problem.num_observations, len(np.unique(problem.point_index))
    poses = 24 if problem.rigs is None else problem.rigs.num_frames
    noise = summary.final_rms_px * np.sqrt(count / (count - 6 * poses - 3 * points + freedoms))
    (found,) = (f for f in sfmcpp.diagnose(problem, summary=summary).findings if f.code == "worst-cameras")
    expected = noise * np.sqrt(np.trace(of_centres, axis1=1, axis2=2).max())
    assert found.measures["worst_sigma"] == pytest.approx(expected, rel=1e-9)
