"""Rigs whose sensors are estimated beside the frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

import sfmcpp
from rig_cases import WAYS_TO_SOLVE, costs_of_a_step, is_rigid, rigs_of
from sfmcpp import ConstraintGroup, InvalidArgument, Problem, ResidualGroup
from sfmcpp.ba import explore_step
from sfmcpp.geometry import so3

Array = NDArray[np.float64]


def scene(**options: Any) -> Problem:
    """Two cameras ahead and one back, eight frames, all sensors free but the first.

    Turned about all axes: were it about one alone, on a short way the height of the camera that looks back
    would be free.
    """
    problem = sfmcpp.rig_walk_scene(
        **{"num_cameras": 24, "num_points": 600, "length_m": 8.0, "seed": 3} | options
    )
    problem.rigs = rigs_of(problem).freed()
    noise = sfmcpp.residuals(problem)
    turns = np.zeros((rigs_of(problem).num_frames, 6))
    turns[:, :3] = 0.3 * np.random.default_rng(7).normal(size=(len(turns), 3))
    problem = moved(problem, turns, np.zeros((3, 6)))
    problem.pixels += noise - sfmcpp.residuals(problem)
    return problem


def moved(problem: Problem, frame_steps: Array, sensor_steps: Array) -> Problem:
    """The problem after steps (F, 6) of frames and (S, 6) of sensors."""
    rigs = rigs_of(problem).copy()
    frames = rigs.frames(problem.cameras)
    for poses, steps in ((frames, frame_steps), (rigs.sensors, sensor_steps)):
        poses[:, :, :3] = poses[:, :, :3] @ so3.exp(steps[:, :3])
        poses[:, :, 3] += steps[:, 3:]
    return replace(problem, rigs=rigs, cameras=rigs.cameras(frames))


def mounted_wrongly(problem: Problem, size: float = 0.02, seed: int = 5) -> Problem:
    """The problem with its free sensors turned and moved away."""
    rigs = rigs_of(problem)
    steps = size * np.random.default_rng(seed).normal(size=(rigs.num_sensors, 6))
    steps[~rigs.free_sensors] = 0
    return moved(problem, np.zeros((rigs.num_frames, 6)), steps)


def started(truth: Problem) -> Problem:
    moved_away = sfmcpp.perturb(
        truth, point_sigma_m=0.03, position_sigma_m=0.03, rotation_sigma_deg=0.3, seed=1
    )
    return mounted_wrongly(moved_away)


OPTIMUM = started(scene())
SUMMARY = sfmcpp.solve(OPTIMUM, function_tolerance=1e-12)


@pytest.mark.parametrize("options", WAYS_TO_SOLVE, ids=str)
def test_every_way_to_solve_finds_the_same_optimum(options: dict[str, Any]) -> None:
    problem = started(scene())
    summary = sfmcpp.solve(problem, function_tolerance=1e-12, **options)
    assert summary.converged
    assert summary.final_cost == pytest.approx(SUMMARY.final_cost, rel=1e-8)
    assert is_rigid(problem)


@pytest.mark.parametrize("preconditioner", ["two-levels", "clusters"])
def test_two_levels_and_clusters_find_it_too(preconditioner: Any) -> None:
    problem = started(scene())
    sfmcpp.solve(problem, linear_solver="iterative", preconditioner=preconditioner, function_tolerance=1e-12)
    assert sfmcpp.cost(problem) == pytest.approx(SUMMARY.final_cost, rel=1e-8)


def test_sensors_come_back_to_their_places() -> None:
    truth = scene(pixel_sigma_px=0.1)
    problem = started(truth)
    before = rigs_of(problem).sensors.copy()
    sfmcpp.solve(problem)
    scale = np.linalg.norm(np.diff(truth.centres[[0, -1]], axis=0)) / np.linalg.norm(
        np.diff(problem.centres[[0, -1]], axis=0)
    )
    found, start, true = (x.copy() for x in (rigs_of(problem).sensors, before, rigs_of(truth).sensors))
    found[:, :, 3] *= scale
    np.testing.assert_array_equal(found[0, :, :3], start[0, :, :3])
    assert np.abs(found - true).max() < 0.1 * np.abs(start - true).max()
    fixed = started(truth)
    fixed.rigs = replace(rigs_of(fixed), free_sensors=None)
    assert sfmcpp.solve(fixed).final_cost > 10 * sfmcpp.cost(problem)


def exact_start() -> Problem:
    """Exact pixels, points that stay, frames and sensors turned a little and far from each other."""
    truth = scene(pixel_sigma_px=0.0, baseline_m=3.0)
    problem = mounted_wrongly(sfmcpp.perturb(truth, rotation_sigma_deg=0.3, seed=2), size=0.005)
    problem.fixed_points[:] = True
    return problem


def test_algebraic_cost_of_a_step_falls_with_the_square_of_the_error() -> None:
    step = explore_step(exact_start(), lengths=[(0.0, 0.0), (1.0, 1.0)], initial_damping=1e-12)
    assert step.algebraic[1] < 1e-3 * step.algebraic[0]


def test_geodesic_acceleration_knows_how_frames_and_sensors_bend() -> None:
    straight, bent = costs_of_a_step(exact_start())
    assert bent < 1e-2 * straight


def ranges(truth: Problem) -> ResidualGroup:
    """Distances of points from cameras, of every fifth observation, good to a centimetre."""
    cameras, points = truth.camera_index[::5], truth.point_index[::5]
    measured = np.linalg.norm(truth.points[points] - truth.centres[cameras], axis=1)

    def errors(poses: Array, points: Array) -> Array:
        return (np.linalg.norm(points - poses[:, :, 3], axis=1) - measured)[:, None] / 0.01

    return ResidualGroup(errors, cameras, points=points)


@pytest.mark.parametrize("beside", [[], [ranges]], ids=["images", "images and ranges"])
def test_scipy_finds_the_same_optimum_of_frames_and_sensors(beside: list[Any]) -> None:
    truth = scene(num_cameras=9, num_points=40, length_m=0.5)
    groups = [group(truth) for group in beside]
    problem = started(truth)
    problem.fixed_cameras[:3] = True
    problem.fixed_points[:3] = True
    other = problem.copy()
    free = rigs_of(problem).free_sensors

    def residuals(x: Array) -> Array:
        frames, sensors = np.zeros((3, 6)), np.zeros((3, 6))
        frames[1:], sensors[free] = x[:12].reshape(2, 6), x[12:24].reshape(2, 6)
        points = other.points.copy()
        points[3:] += x[24:].reshape(-1, 3)
        there = replace(moved(other, frames, sensors), points=points)
        own = [g.evaluate(there.cameras[g.cameras, None], points[g.points]).residuals for g in groups]
        return np.concatenate([part.ravel() for part in (sfmcpp.residuals(there), *own)])

    found = least_squares(residuals, np.zeros(24 + 3 * (problem.num_points - 3)), method="lm")
    summary = sfmcpp.solve(problem, constraints=groups, function_tolerance=1e-12)
    assert summary.final_cost == pytest.approx(found.cost, rel=1e-6)


def test_jacobian_is_the_numeric_derivative_by_frames_and_sensors() -> None:
    problem = scene(camera_model="perspective", pixel_sigma_px=0.5)
    group = ConstraintGroup(
        "position", np.array([1, 5]), problem.centres[[1, 5]] + 0.1, weight=4.0, name="gps"
    )
    model = sfmcpp.linearize(problem, constraints=[group])
    jacobian, rows = model.jacobian().toarray(), model.groups[0].jacobian().toarray()
    names = model.parameter_names
    first = names.index("sensor rotation x")
    assert names[first + 3] == "sensor centre x"
    rigs, h = rigs_of(problem), 1e-6
    assert (model.camera_columns[rigs.sensor_of_camera == 0, first:] == -1).all()
    for sensor, k in ((1, 0), (1, 4), (2, 2), (2, 5)):
        step = np.zeros((rigs.num_sensors, 6))
        step[sensor, k] = h
        ahead, behind = (moved(problem, np.zeros((rigs.num_frames, 6)), s) for s in (step, -step))
        numeric = (sfmcpp.residuals(ahead) - sfmcpp.residuals(behind)).ravel() / (2 * h)
        column = model.camera_columns[sensor, first + k]
        assert (model.camera_columns[rigs.sensor_of_camera == sensor, first + k] == column).all()
        np.testing.assert_allclose(jacobian[:, column], numeric, atol=1e-4 * np.abs(numeric).max())
        errors = [sfmcpp.linearize(p, constraints=[group]).groups[0].errors for p in (ahead, behind)]
        np.testing.assert_allclose(rows[:, column], (errors[0] - errors[1]) / (2 * h), atol=1e-8)


def seen_often(problem: Problem) -> Problem:
    """Without the points that no two frames see."""
    pairs = np.unique(
        np.stack([problem.point_index, rigs_of(problem).frame_of_camera[problem.camera_index]]), axis=1
    )
    frames = np.bincount(pairs[0], minlength=problem.num_points)
    return problem.with_observations(frames[problem.point_index] > 1)


def test_free_sensors_leave_the_scale_to_the_gauge() -> None:
    problem = seen_often(scene())
    model = sfmcpp.linearize(problem)
    assert model.num_camera_columns == 6 * rigs_of(problem).num_frames + 12
    assert model.num_determined == model.num_columns - 7
    held = replace(rigs_of(problem), free_sensors=np.array([False, False, True]))
    model = sfmcpp.linearize(replace(problem, rigs=held))
    assert model.num_determined == model.num_columns - 6


@pytest.mark.parametrize("place", [0.0, 0.7])
def test_free_covariance_is_the_pseudo_inverse(place: float) -> None:
    # The sensor that stays need not be at the origin of its rig.
    problem = scene(num_cameras=9, num_points=60, length_m=1.0)
    rigs = rigs_of(problem)
    frames = rigs.frames(problem.cameras)
    rigs.sensors[:, :, 3] += place
    frames[:, :, 3] -= place * frames[:, :, :3].sum(axis=2)
    np.testing.assert_allclose(rigs.cameras(frames), problem.cameras, atol=1e-12)
    problem = seen_often(problem)
    sfmcpp.solve(problem)
    model = sfmcpp.linearize(problem, datum="all")
    found = model.covariance(cameras=[4]).cameras[0]
    inverse = np.linalg.pinv(model.normal_matrix().toarray(), rcond=1e-11, hermitian=True)
    motion = np.eye(12)
    motion[:6, :6] = rigs_of(problem).motions(problem.cameras)[4]
    motion[:6, 6:] = rigs_of(problem).sensor_motions(problem.cameras)[4]
    columns = model.camera_columns[4]
    expected = motion @ inverse[np.ix_(columns, columns)] @ motion.T
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max())


def test_one_frame_alone_has_its_gauge_held_by_a_sensor() -> None:
    problem = scene(num_cameras=3, num_points=60, length_m=1.0)
    counts = np.bincount(problem.point_index, minlength=problem.num_points)
    problem = problem.with_observations(counts[problem.point_index] > 1)
    model = sfmcpp.linearize(problem, gauge="fixed")
    seen = np.count_nonzero(model.point_columns >= 0)
    assert model.num_camera_columns < 6 + 12
    assert model.num_columns == model.num_camera_columns + 3 * seen


def test_bits_do_not_depend_on_threads() -> None:
    results = []
    for threads in (1, 2):
        problem = started(scene())
        sfmcpp.solve(problem, threads=threads)
        results.append(np.concatenate([problem.cameras, rigs_of(problem).sensors]))
    np.testing.assert_array_equal(*results)


def test_saved_run_goes_on_with_the_same_bits(tmp_path: Path) -> None:
    whole, part = started(scene()), started(scene())
    sfmcpp.solve(whole)
    store = sfmcpp.CheckpointFolder(tmp_path)
    sfmcpp.solve(part, max_iterations=2, checkpoint=store)
    again = started(scene())
    sfmcpp.solve(again, resume=store)
    np.testing.assert_array_equal(rigs_of(again).sensors, rigs_of(whole).sensors)
    np.testing.assert_array_equal(again.cameras, whole.cameras)


def test_undamped_step_of_the_linear_model_moves_sensors() -> None:
    problem = started(scene())
    after = sfmcpp.linearize(problem).step().problem
    assert (rigs_of(after).sensors[1:] != rigs_of(problem).sensors[1:]).any(axis=(1, 2)).all()
    assert is_rigid(after)


def test_cameras_without_observations_go_where_their_sensor_goes() -> None:
    problem = started(scene())
    problem = problem.with_observations(problem.camera_index >= 4)  # all of frame 0, one of frame 1
    sfmcpp.solve(problem)
    assert is_rigid(problem)


def test_sensor_without_observations_is_left_and_told() -> None:
    problem = started(scene())
    kept = rigs_of(problem).sensor_of_camera[problem.camera_index] != 2
    problem = problem.with_observations(kept)
    before = rigs_of(problem).sensors.copy()
    warning = "rigs.free_sensors[2]: left as given: no observations"
    assert warning in sfmcpp.check(problem)
    assert warning in sfmcpp.solve(problem).warnings
    np.testing.assert_array_equal(rigs_of(problem).sensors[[0, 2]], before[[0, 2]])
    assert is_rigid(problem)


def test_of_sensors_that_are_all_free_the_first_is_left_and_told() -> None:
    problem = started(scene())
    problem.rigs = replace(rigs_of(problem), free_sensors=np.ones(3, bool))
    summary = sfmcpp.solve(problem, function_tolerance=1e-12)
    assert any("rigs.free_sensors[0]: left as given: all" in text for text in summary.warnings)
    assert summary.final_cost == pytest.approx(SUMMARY.final_cost, rel=1e-8)


def test_known_frames_calibrate_all_sensors() -> None:
    truth = scene(pixel_sigma_px=0.0)
    truth.rigs = replace(rigs_of(truth), free_sensors=np.ones(3, bool))
    problem = mounted_wrongly(truth)
    problem.fixed_cameras[:] = True
    frames = rigs_of(problem).frames(problem.cameras)
    assert not sfmcpp.solve(problem, function_tolerance=1e-14).warnings
    np.testing.assert_allclose(rigs_of(problem).sensors, rigs_of(truth).sensors, atol=1e-6)
    np.testing.assert_allclose(rigs_of(problem).frames(problem.cameras), frames, atol=1e-12)


def test_place_of_a_lone_sensor_in_a_rig_that_turns_about_one_axis_is_said_to_be_free() -> None:
    # The camera that looks back sees no point of the others: the way is too short.
    problem = seen_often(sfmcpp.rig_walk_scene(9, 60, length_m=1.0, pixel_sigma_px=0.0, seed=3))
    problem.rigs = rigs_of(problem).freed()
    model = sfmcpp.linearize(problem)
    for _ in range(2):  # as often as it is asked
        with pytest.raises(InvalidArgument, match=r"rigs.sensors\[2\]: its pose .* is not determined"):
            model.covariance(cameras=[0])
    away = mounted_wrongly(problem)
    assert sfmcpp.solve(away, function_tolerance=1e-14).final_cost < 1e-6
    assert is_rigid(away)


def test_intrinsics_are_found_beside_sensors_up_to_six() -> None:
    truth = scene(camera_model="perspective", pixel_sigma_px=0.2)
    problem = sfmcpp.perturb(started(truth), focal_sigma=0.01, seed=4).set_free_intrinsics("f")
    assert sfmcpp.solve(problem).converged
    np.testing.assert_allclose(problem.intrinsics[:, 0], truth.intrinsics[:, 0], rtol=5e-3)
    problem.set_free_intrinsics("f", "aspect", "cx", "cy", "k1", "k2", "p1")
    with pytest.raises(InvalidArgument, match="7 intrinsics are free beside sensors, must be at most 6"):
        sfmcpp.solve(problem)


@pytest.mark.parametrize("free", [("f",), ("f", "k1", "k2")])
def test_bal_cameras_have_room_for_sensors_beside_intrinsics(free: tuple[str, ...]) -> None:
    truth = scene(camera_model="bal", pixel_sigma_px=0.2)
    problem = sfmcpp.perturb(started(truth), focal_sigma=0.01, seed=4).set_free_intrinsics(*free)
    assert sfmcpp.solve(problem).converged
    np.testing.assert_allclose(problem.intrinsics[:, 0], truth.intrinsics[:, 0], rtol=5e-3)


def test_flags_of_another_length_or_kind_are_refused() -> None:
    for flags in (np.ones(2, bool), np.ones(3)):
        with pytest.raises(InvalidArgument, match=r"rigs.free_sensors: .* must be bool of shape \(3,\)"):
            replace(rigs_of(scene()), free_sensors=flags)


def test_file_keeps_which_sensors_are_free(tmp_path: Path) -> None:
    problem = scene()
    sfmcpp.write(problem, tmp_path / "scene.npz")
    np.testing.assert_array_equal(
        rigs_of(sfmcpp.read(tmp_path / "scene.npz")).free_sensors, [False, True, True]
    )
