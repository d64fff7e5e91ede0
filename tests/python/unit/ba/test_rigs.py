"""Problems of rigs: one pose for a frame, whatever solves them."""

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
from sfmcpp import ConstraintGroup, InvalidArgument, Problem, Rigs
from sfmcpp.ba import explore_step
from sfmcpp.geometry import so3

Array = NDArray[np.float64]


def scene(**options: Any) -> Problem:
    """Two cameras ahead and one back, eight frames."""
    return sfmcpp.rig_walk_scene(
        **{"num_cameras": 24, "num_points": 600, "length_m": 8.0, "seed": 3} | options
    )


def started(truth: Problem, seed: int = 1) -> Problem:
    return sfmcpp.perturb(truth, point_sigma_m=0.03, position_sigma_m=0.03, rotation_sigma_deg=0.3, seed=seed)


def moved_frames(problem: Problem, step: Array) -> Array:
    """Cameras whose frames moved by (F, 6)."""
    frames = rigs_of(problem).frames(problem.cameras)
    frames[:, :, :3] = frames[:, :, :3] @ so3.exp(step[:, :3])
    frames[:, :, 3] += step[:, 3:]
    return rigs_of(problem).cameras(frames)


def with_gap(problem: Problem, camera: int) -> Problem:
    return problem.with_observations(problem.camera_index != camera)


def seen_from_two_frames(problem: Problem) -> Problem:
    frames = [set() for _ in range(problem.num_points)]  # type: list[set[int]]
    for camera, point in zip(problem.camera_index, problem.point_index, strict=True):
        frames[point].add(int(rigs_of(problem).frame_of_camera[camera]))
    kept = np.array([len(of_point) > 1 for of_point in frames])
    return problem.with_observations(kept[problem.point_index])


SOLVED = started(scene())
OPTIMUM = sfmcpp.solve(SOLVED, function_tolerance=1e-12)


@pytest.mark.parametrize("options", WAYS_TO_SOLVE, ids=str)
def test_every_way_to_solve_finds_the_same_optimum(options: dict[str, Any]) -> None:
    problem = started(scene())
    summary = sfmcpp.solve(problem, function_tolerance=1e-12, **options)
    assert summary.converged
    assert summary.final_cost == pytest.approx(OPTIMUM.final_cost, rel=1e-8)
    assert is_rigid(problem)


def exact_start() -> Problem:
    """Exact pixels, points that stay, frames turned a little; the cameras far from their middle."""
    truth = scene(pixel_sigma_px=0.0, baseline_m=3.0)
    problem = sfmcpp.perturb(truth, rotation_sigma_deg=0.3, seed=2)
    problem.fixed_points[:] = True
    return problem


def test_algebraic_cost_of_a_step_falls_with_the_square_of_the_error() -> None:
    step = explore_step(exact_start(), lengths=[(0.0, 0.0), (1.0, 1.0)], initial_damping=1e-12)
    assert step.algebraic[1] < 1e-4 * step.algebraic[0]


def test_geodesic_acceleration_knows_how_centres_bend_about_their_frame() -> None:
    straight, bent = costs_of_a_step(exact_start())
    assert bent < 1e-2 * straight


def test_two_levels_of_preconditioning_find_it_too() -> None:
    problem = started(scene())
    sfmcpp.solve(problem, linear_solver="iterative", preconditioner="two-levels", function_tolerance=1e-12)
    assert sfmcpp.cost(problem) == pytest.approx(OPTIMUM.final_cost, rel=1e-8)


def test_scipy_finds_the_same_optimum_of_frames() -> None:
    problem = started(scene(num_cameras=6, num_points=40, length_m=0.5))
    problem.fixed_cameras[:3] = True
    other = problem.copy()

    def residuals(x: Array) -> Array:
        step = np.concatenate([np.zeros(6), x[:6]]).reshape(2, 6)
        points = other.points + x[6:].reshape(-1, 3)
        return sfmcpp.residuals(replace(other, cameras=moved_frames(other, step), points=points)).ravel()

    found = least_squares(residuals, np.zeros(6 + problem.points.size), method="lm")
    summary = sfmcpp.solve(problem, function_tolerance=1e-12)
    assert summary.final_cost == pytest.approx(found.cost, rel=1e-6)


def test_jacobian_is_the_numeric_derivative_by_the_frames() -> None:
    problem = scene(camera_model="perspective", pixel_sigma_px=0.5)
    group = ConstraintGroup(
        "position", np.array([1, 5]), problem.centres[[1, 5]] + 0.1, weight=4.0, name="gps"
    )
    model = sfmcpp.linearize(problem, constraints=[group])
    jacobian, rows = model.jacobian().toarray(), model.groups[0].jacobian().toarray()
    h = 1e-6
    for frame, k in ((0, 0), (0, 4), (1, 1), (1, 2), (1, 5)):
        step = np.zeros((rigs_of(problem).num_frames, 6))
        step[frame, k] = h
        ahead, behind = (replace(problem, cameras=moved_frames(problem, s)) for s in (step, -step))
        numeric = (sfmcpp.residuals(ahead) - sfmcpp.residuals(behind)).ravel() / (2 * h)
        column = model.camera_columns[3 * frame, k]
        assert (model.camera_columns[3 * frame : 3 * frame + 3, k] == column).all()
        np.testing.assert_allclose(jacobian[:, column], numeric, atol=1e-4 * np.abs(numeric).max())
        errors = [sfmcpp.linearize(p, constraints=[group]).groups[0].errors for p in (ahead, behind)]
        np.testing.assert_allclose(rows[:, column], (errors[0] - errors[1]) / (2 * h), atol=1e-8)


def test_frames_have_six_columns_and_the_rig_the_scale() -> None:
    model = sfmcpp.linearize(SOLVED)
    assert model.num_camera_columns == 6 * rigs_of(SOLVED).num_frames
    assert model.num_determined == model.num_columns - 6


def test_rig_of_one_place_leaves_the_scale_free() -> None:
    problem = seen_from_two_frames(scene())
    sensors = rigs_of(problem).sensors.copy()
    sensors[:, :, 3] = 0
    rigs = Rigs(sensors, rigs_of(problem).frame_of_camera, rigs_of(problem).sensor_of_camera)
    model = sfmcpp.linearize(replace(problem, rigs=rigs, cameras=rigs.rigid(problem.cameras)))
    assert model.num_determined == model.num_columns - 7


def test_rig_is_nearer_to_the_truth_than_its_cameras_alone() -> None:
    truth = scene(seed=8)
    rigid, alone = started(truth), replace(started(truth), rigs=None)
    errors = []
    for problem in (rigid, alone):
        sfmcpp.solve(problem)
        turns = problem.rotations[:-1].transpose(0, 2, 1) @ problem.rotations[1:]
        true_turns = truth.rotations[:-1].transpose(0, 2, 1) @ truth.rotations[1:]
        errors.append(so3.rotation_angle(turns.transpose(0, 2, 1) @ true_turns).mean())
    assert errors[0] < 0.5 * errors[1]


def test_scale_follows_from_the_baseline() -> None:
    truth = scene(pixel_sigma_px=0.1)
    problem = truth.copy()
    problem.cameras[:] = rigs_of(problem).cameras(
        rigs_of(problem).frames(problem.cameras) * [[[1, 1, 1, 1.05]] * 3]
    )
    problem.points *= 1.05
    sfmcpp.solve(problem)
    way, true_way = (np.linalg.norm(p.centres[-1] - p.centres[0]) for p in (problem, truth))
    assert way == pytest.approx(true_way, rel=2e-3)


def test_fixed_frame_stays_and_the_others_move() -> None:
    problem = started(scene())
    problem.fixed_cameras[3:6] = True
    before = problem.cameras.copy()
    sfmcpp.solve(problem)
    np.testing.assert_array_equal(problem.cameras[3:6], before[3:6])
    assert (problem.cameras[6:] != before[6:]).any(axis=(1, 2)).all()
    assert is_rigid(problem)


def test_intrinsics_shared_by_a_sensor_are_found_beside_the_frames() -> None:
    truth = scene(camera_model="perspective", pixel_sigma_px=0.2)
    problem = sfmcpp.perturb(started(truth), focal_sigma=0.01, seed=4).set_free_intrinsics("f")
    summary = sfmcpp.solve(problem)
    assert summary.converged
    np.testing.assert_allclose(problem.intrinsics[:, 0], truth.intrinsics[:, 0], rtol=2e-3)
    dense, iterative = started(truth), started(truth)
    for other, solver in ((dense, "dense"), (iterative, "iterative")):
        other.set_free_intrinsics("f")
        sfmcpp.solve(other, linear_solver=solver, function_tolerance=1e-12)  # type: ignore[arg-type]
    np.testing.assert_allclose(dense.intrinsics[:, 0], iterative.intrinsics[:, 0], rtol=1e-6)


def test_camera_without_observations_moves_with_its_frame() -> None:
    problem = with_gap(started(scene()), 0)  # the first of its frame, and with it another
    problem = with_gap(problem, 4)
    assert not any("no observations" in text for text in sfmcpp.check(problem) if "camera" in text)
    before = problem.cameras.copy()
    summary = sfmcpp.solve(problem)
    assert summary.converged
    assert is_rigid(problem)
    assert (problem.cameras[[0, 4]] != before[[0, 4]]).any(axis=(1, 2)).all()


def test_a_frame_without_images_is_held_by_constraints_on_any_of_its_cameras() -> None:
    truth = scene()
    problem = started(truth)
    first, second, _ = np.flatnonzero(rigs_of(truth).frame_of_camera == 3)
    before = int(np.flatnonzero(rigs_of(truth).frame_of_camera == 2)[0])
    unseen = problem.with_observations(rigs_of(problem).frame_of_camera[problem.camera_index] != 3)
    orientation = ConstraintGroup("orientation", [first], truth.rotations[[first]], weight=1e6)
    position = ConstraintGroup("position", [second], truth.centres[[second]], weight=1e6)
    pose = ConstraintGroup("pose", [first], truth.cameras[[first]], weight=1e6)
    way = truth.centres[[second]] - truth.centres[[before]]
    step = ConstraintGroup("displacement-translation", [[before, second]], way, weight=1e6)
    for groups in ([orientation, position], [pose, step]):
        moved = unseen.copy()
        summary = sfmcpp.solve(moved, constraints=groups)
        assert not any("left as given" in warning for warning in summary.warnings)
        assert is_rigid(moved)
        start, end = np.array(list(summary.constraint_costs.values())).T
        assert (end < 1e-4 * start).all()


def test_what_cameras_of_one_frame_are_to_each_other_does_not_hold_it() -> None:
    problem = started(scene())
    first, second, third = np.flatnonzero(rigs_of(problem).frame_of_camera == 3)
    unseen = problem.with_observations(rigs_of(problem).frame_of_camera[problem.camera_index] != 3)
    poses = np.concatenate([problem.cameras, np.tile([[[0, 0, 0, 1.0]]], (24, 1, 1))], axis=1)
    pairs = np.array([[first, second], [second, third], [first, third]])
    steps = (np.linalg.inv(poses[pairs[:, 0]]) @ poses[pairs[:, 1]])[:, :3]
    inside = ConstraintGroup("displacement-pose", pairs, steps)
    with pytest.raises(InvalidArgument, match="has no observations, and constraints do not determine"):
        sfmcpp.solve(unseen, constraints=[inside])


def test_constraint_between_cameras_of_one_frame_meets_itself() -> None:
    # A displacement within a frame and one between two; the first has the columns of both cameras.
    truth = scene()
    pairs = np.array([[0, 1], [4, 7]])
    steps = np.diff(truth.centres[pairs], axis=1)[:, 0]
    groups = [
        ConstraintGroup("displacement-translation", pairs, steps + 0.02, weight=1e4, name="steps"),
        ConstraintGroup("position", np.array([1, 22]), truth.centres[[1, 22]], weight=1e4, name="gps"),
    ]
    costs = []
    for solver in ("dense", "sparse", "iterative"):
        problem = started(truth)
        options: dict[str, Any] = {"linear_solver": solver, "function_tolerance": 1e-13}
        costs.append(sfmcpp.solve(problem, constraints=groups, **options).final_cost)
        if solver == "dense":
            assert relative_gradient(sfmcpp.linearize(problem, constraints=groups)) < 1e-5
    np.testing.assert_allclose(costs, costs[0], rtol=1e-9)


def relative_gradient(model: sfmcpp.LinearModel) -> float:
    """Largest entry of the gradient, in the units of the normal matrix and the cost."""
    gradient = model.jacobian().T @ model.residuals.ravel()
    for rows in model.groups:
        gradient[: rows.columns] += rows.weight * (rows.jacobian().T @ rows.errors)
    return float(np.abs(gradient / np.sqrt(model.normal_matrix().diagonal() * model.cost)).max())


def test_covariance_of_a_camera_is_that_of_its_frame_moved_to_it() -> None:
    model = sfmcpp.linearize(SOLVED, gauge="fixed")
    found = model.covariance(cameras=[9, 10], joint=True)
    columns = model.camera_columns[9]
    inverse = np.linalg.inv(model.normal_matrix().toarray())[np.ix_(columns, columns)]
    motions = rigs_of(SOLVED).motions(SOLVED.cameras)[[9, 10]]
    for camera, motion in zip(found.cameras, motions, strict=True):
        np.testing.assert_allclose(camera, motion @ inverse @ motion.T, rtol=1e-6, atol=1e-12)
    joint = np.concatenate(motions) @ inverse @ np.concatenate(motions).T
    np.testing.assert_allclose(found.joint, joint, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("case", ["bare", "distance within a frame", "sensor without images"])
def test_free_covariance_is_the_pseudo_inverse(case: str) -> None:
    problem, groups = started(scene(num_cameras=9, num_points=60, length_m=1.0)), []
    if case == "distance within a frame":  # that of the rig: its derivative is rounding
        problem = seen_from_two_frames(started(scene(num_cameras=9, num_points=120, length_m=6.0)))
        groups = [ConstraintGroup("scale", [[3, 4]], [0.5], weight=100.0)]
    if case == "sensor without images":  # the first of its frames
        problem = seen_from_two_frames(problem.with_observations(problem.camera_index % 3 != 0))
    sfmcpp.solve(problem)
    model = sfmcpp.linearize(problem, constraints=groups, datum="all")
    found = model.covariance(cameras=[4]).cameras[0]
    inverse = np.linalg.pinv(model.normal_matrix().toarray(), rcond=1e-11, hermitian=True)
    motion = rigs_of(problem).motions(problem.cameras)[4]
    columns = model.camera_columns[4]
    expected = motion @ inverse[np.ix_(columns, columns)] @ motion.T
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max())


def test_bits_do_not_depend_on_threads() -> None:
    results = []
    for threads in (1, 2):
        problem = started(scene())
        sfmcpp.solve(problem, threads=threads)
        results.append(problem.cameras)
    np.testing.assert_array_equal(*results)


def test_saved_run_goes_on_with_the_same_bits(tmp_path: Path) -> None:
    whole, part = started(scene()), started(scene())
    sfmcpp.solve(whole)
    store = sfmcpp.CheckpointFolder(tmp_path)
    sfmcpp.solve(part, max_iterations=2, checkpoint=store)
    again = started(scene())
    sfmcpp.solve(again, resume=store)
    np.testing.assert_array_equal(again.cameras, whole.cameras)


def test_one_camera_in_each_frame_is_no_rig_at_all() -> None:
    truth = sfmcpp.circle_scene(6, 100, seed=0)
    alone, framed = started(truth), started(truth)
    framed.rigs = Rigs(np.eye(3, 4)[None], np.arange(6), np.zeros(6, np.int32))
    costs = [sfmcpp.solve(p, function_tolerance=1e-12).final_cost for p in (alone, framed)]
    assert costs[0] == pytest.approx(costs[1], rel=1e-12)


def test_cameras_out_of_their_frame_are_refused_by_name() -> None:
    problem = scene()
    problem.cameras[4, 0, 3] += 0.01
    with pytest.raises(InvalidArgument, match=r"cameras\[4\]: 0.01.* frame and sensor 1 put it"):
        sfmcpp.solve(problem)
    problem.cameras[:] = rigs_of(problem).rigid(problem.cameras)
    sfmcpp.solve(problem)


def test_frame_that_is_fixed_in_part_is_refused() -> None:
    problem = scene()
    problem.fixed_cameras[7] = True
    with pytest.raises(InvalidArgument, match=r"fixed_cameras\[7\]: differs from that of camera 6"):
        sfmcpp.solve(problem)


def test_projective_cameras_form_no_rig() -> None:
    problem = scene()
    projective = replace(sfmcpp.as_projective(replace(problem, rigs=None)), rigs=problem.rigs)
    with pytest.raises(InvalidArgument, match="projective"):
        sfmcpp.solve(projective)
