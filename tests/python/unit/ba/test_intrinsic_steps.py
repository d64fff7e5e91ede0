"""Intrinsics wait until the poses have settled, where the first steps would blame them for wrong poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp


def far_start(seed: int, level: float = 2.0) -> tuple[sfmcpp.Problem, sfmcpp.Problem]:
    """A corridor of BAL cameras, `level` × (1°, 0.3 m) off; and the same from the truth."""
    truth = sfmcpp.corridor_scene(50, 2000, camera_model="bal", seed=seed)
    off = 0.3 * level
    start = sfmcpp.perturb(
        truth, point_sigma_m=off, position_sigma_m=off, rotation_sigma_deg=level, seed=seed
    )
    return start, truth


def held_steps(summary: sfmcpp.Summary) -> list[bool]:
    return [i.intrinsics_held for i in summary.iterations]


@pytest.mark.parametrize("loss", ["squared", "huber"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_far_starts_come_near_the_minimum_of_the_truth(seed: int, loss: str) -> None:
    start, truth = far_start(seed)
    least = sfmcpp.solve(truth, loss=loss, max_iterations=100).final_cost
    at_once = sfmcpp.solve(start.copy(), loss=loss, max_iterations=30, intrinsic_steps="whole")
    late = sfmcpp.solve(start, loss=loss, max_iterations=30)
    assert late.final_cost - least < 0.1 * (at_once.final_cost - least)
    held = held_steps(late)
    first_free = held.index(False, 1)
    assert 2 <= first_free - 1 <= 10
    assert not any(held[first_free:])
    assert not any(held_steps(at_once))


def test_held_intrinsics_stay_as_they_are() -> None:
    start, _ = far_start(1)
    before = start.intrinsics.copy()
    summary = sfmcpp.solve(start, max_iterations=2)
    assert held_steps(summary) == [False, True, True]
    assert summary.describe_steps() == "2 (2 accepted, 2 with intrinsics held)"
    np.testing.assert_allclose(start.intrinsics[:, 0], before[:, 0], rtol=1e-4)


def test_the_damping_begins_anew_where_intrinsics_are_freed() -> None:
    summary = sfmcpp.solve(far_start(1)[0], max_iterations=30)
    dampings, held = [i.damping for i in summary.iterations], held_steps(summary)
    first_free = held.index(False, 2)
    assert dampings[first_free - 1] < 0.5 * dampings[1]
    assert dampings[first_free] == dampings[1]


def test_held_steps_are_those_of_fixed_intrinsics() -> None:
    start, _ = far_start(1)
    fixed = start.copy()
    fixed.fixed_intrinsics[:] = True
    late = sfmcpp.solve(start, max_iterations=3)
    of_poses = sfmcpp.solve(fixed, max_iterations=3)
    costs = [[i.cost for i in summary.iterations] for summary in (late, of_poses)]
    np.testing.assert_allclose(costs[0], costs[1], rtol=1e-3)


def test_focal_lengths_that_are_wrong_are_moved_at_once() -> None:
    """Photos whose poses are right: the images ask for other focal lengths, by 10 %."""
    scene = sfmcpp.photo_collection_scene(30, seed=1)
    start = sfmcpp.perturb(scene, point_sigma_m=0.05, position_sigma_m=0.05, focal_sigma=0.1, seed=1)
    whole = start.copy()
    summary = sfmcpp.solve(start)
    assert not any(held_steps(summary))
    sfmcpp.solve(whole, intrinsic_steps="whole")
    np.testing.assert_array_equal(start.points, whole.points)


def test_near_starts_have_the_same_bits_without() -> None:
    start, _ = far_start(4, level=0.2)
    whole = start.copy()
    assert not any(held_steps(sfmcpp.solve(start)))
    sfmcpp.solve(whole, intrinsic_steps="whole")
    np.testing.assert_array_equal(start.points, whole.points)


@pytest.mark.parametrize("solver", ["dense", "sparse", "iterative"])
def test_every_linear_solver_holds_them(solver: str) -> None:
    start, truth = far_start(2)
    least = sfmcpp.solve(truth, max_iterations=100).final_cost
    at_once = sfmcpp.solve(start.copy(), linear_solver=solver, max_iterations=20, intrinsic_steps="whole")
    late = sfmcpp.solve(start, linear_solver=solver, max_iterations=20)
    assert any(held_steps(late))
    assert late.final_cost - least < 0.1 * (at_once.final_cost - least)


def test_the_same_bits_for_any_number_of_threads() -> None:
    solved = []
    for threads in (1, 2, 3):
        start, _ = far_start(1)
        assert any(held_steps(sfmcpp.solve(start, threads=threads, max_iterations=8)))
        solved.append(start)
    for other in solved[1:]:
        np.testing.assert_array_equal(other.points, solved[0].points)
        np.testing.assert_array_equal(other.intrinsics, solved[0].intrinsics)


@pytest.mark.parametrize("stop", [1, 3, 6])
def test_a_run_that_is_resumed_holds_them_as_before(tmp_path: Path, stop: int) -> None:
    whole, _ = far_start(1)
    uninterrupted = sfmcpp.solve(whole, max_iterations=12)
    start, _ = far_start(1)
    sfmcpp.solve(start, max_iterations=stop, checkpoint=sfmcpp.CheckpointFolder(tmp_path))
    again, _ = far_start(1)
    resumed = sfmcpp.solve(again, max_iterations=12, resume=sfmcpp.CheckpointFolder(tmp_path))
    assert held_steps(resumed) == held_steps(uninterrupted)
    np.testing.assert_array_equal(again.points, whole.points)


@pytest.mark.parametrize("options", [{"method": "dog-leg"}, {"line_search": "exact"}])
def test_what_cannot_hold_them_refuses_by_name(options: dict[str, str]) -> None:
    problem = sfmcpp.circle_scene(4, 30, seed=1)
    with pytest.raises(sfmcpp.InvalidArgument, match="intrinsic_steps = 'late'"):
        sfmcpp.solve(problem, intrinsic_steps="late", **options)
