"""Loss `auto`: outliers are told from the rest, in the same way however the problem is solved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from sfmcpp import ConstraintGroup, InvalidArgument, Problem
from sfmcpp.model.arrays import BoolArray


def half_wrong(
    seed: int, camera_model: str = "calibrated", cameras: int = 12, points: int = 150
) -> tuple[Problem, BoolArray]:
    truth = sfmcpp.circle_scene(cameras, points, pixel_sigma_px=0.5, camera_model=camera_model, seed=seed)
    spoiled, wrong = sfmcpp.add_outliers(truth, 0.5, seed=seed)
    start = sfmcpp.perturb(
        spoiled, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=seed
    )
    return start, wrong


@pytest.mark.parametrize("camera_model", ["calibrated", "perspective", "bal"])
def test_the_weights_tell_outliers(camera_model: str) -> None:
    problem, wrong = half_wrong(1, camera_model)
    summary = sfmcpp.solve(problem, loss="auto", max_iterations=100)
    assert summary.loss_scale_px < 10
    model = sfmcpp.linearize(problem, loss="auto", loss_scale_px=summary.loss_scale_px)
    assert model.loss_scale_px == summary.loss_scale_px
    assert model.cost == pytest.approx(summary.final_cost, rel=1e-12)
    assert np.mean(model.observation_weights[wrong] < 0.5) > 0.99
    assert np.mean(model.observation_weights[~wrong] == 1.0) > 0.98


@pytest.mark.parametrize("error_px", [10.0, 20.0, 50.0])
@pytest.mark.parametrize("share", [0.02, 0.1, 0.4])
def test_outliers_that_lie_near_are_told_too(share: float, error_px: float) -> None:
    truth = sfmcpp.circle_scene(20, 200, pixel_sigma_px=0.7, seed=7)
    spoiled, wrong = sfmcpp.add_outliers(truth, share, sigma_px=error_px, seed=7)
    problem = sfmcpp.perturb(
        spoiled, point_sigma_m=0.05, position_sigma_m=0.05, rotation_sigma_deg=0.3, seed=7
    )
    clean = problem.with_observations(~wrong).copy()
    sfmcpp.solve(clean)
    summary = sfmcpp.solve(problem, loss="auto", max_iterations=200)
    assert summary.loss_scale_px < 8.0
    ours = problem.with_observations(~wrong)
    allowed = 1.3 if error_px > 10.0 else 2.0
    assert (sfmcpp.residuals(ours) ** 2).sum() < allowed * (sfmcpp.residuals(clean) ** 2).sum()


def test_normal_noise_keeps_its_largest_residuals() -> None:
    problem = sfmcpp.circle_scene(20, 500, pixel_sigma_px=0.7, seed=3)
    least = sfmcpp.solve(problem.copy())
    assert sfmcpp.solve(problem, loss="auto").final_cost == pytest.approx(least.final_cost, rel=1e-9)


def test_the_bits_are_the_same_for_any_number_of_threads() -> None:
    solved = []
    for threads in (1, 2, 3):
        problem, _ = half_wrong(2)
        sfmcpp.solve(problem, loss="auto", threads=threads)
        solved.append(problem)
    for other in solved[1:]:
        np.testing.assert_array_equal(other.points, solved[0].points)
        np.testing.assert_array_equal(other.cameras, solved[0].cameras)


def test_the_unit_of_pixels_and_sigma_matter_only_through_their_ratio() -> None:
    problem, _ = half_wrong(3)
    other = problem.copy()
    other.sigma_px = np.full(other.num_observations, 0.25)
    ours = sfmcpp.solve(problem, loss="auto", loss_scale_px="auto")
    theirs = sfmcpp.solve(other, loss="auto", loss_scale_px="auto")
    assert theirs.loss_scale_px == pytest.approx(4.0 * ours.loss_scale_px, rel=1e-9)
    assert theirs.final_cost == pytest.approx(16.0 * ours.final_cost, rel=1e-6)


# A right observation and a wrong one often agree by chance on a point, where a third is missing.
def test_points_of_three_right_views_and_as_many_wrong_ones() -> None:
    problem, wrong = half_wrong(6, cameras=16, points=500)
    first = np.random.default_rng(6).integers(0, 16, 500)
    seen = (problem.camera_index - first[problem.point_index]) % 16 < 6
    problem, right = problem.with_observations(seen), ~wrong[seen]
    clean = problem.with_observations(right).copy()
    sfmcpp.solve(clean, max_iterations=100)
    sfmcpp.solve(problem, loss="auto", max_iterations=100)
    told = (np.bincount(clean.point_index)[clean.point_index] >= 3).nonzero()
    ours, best = (
        (sfmcpp.linearize(solved).residuals ** 2)[told].sum()
        for solved in (problem.with_observations(right), clean)
    )
    assert ours < 1.01 * best


def test_a_projective_world_has_outliers_too() -> None:
    problem = sfmcpp.as_projective(half_wrong(4)[0])
    at_start = sfmcpp.linearize(problem, loss="auto", loss_scale_px="auto").loss_scale_px
    assert sfmcpp.solve(problem, loss="auto", max_iterations=100).loss_scale_px < 0.5 * at_start


def test_a_group_of_constraints_refuses_it_by_name() -> None:
    problem, _ = half_wrong(5)
    group = ConstraintGroup("position", [0, 1], problem.centres[:2], loss="auto")
    with pytest.raises(InvalidArgument, match=r"constraints\['position'\]\.loss = 'auto'"):
        sfmcpp.solve(problem, constraints=[group])


@pytest.mark.parametrize("camera_model", ["calibrated", "bal"])
@pytest.mark.parametrize("seed", [0, 3])
def test_a_camera_of_few_views_that_begins_far_off_is_put_back(camera_model: str, seed: int) -> None:
    problem, wrong = half_wrong(seed, camera_model, cameras=16)
    rows = np.random.default_rng(seed).permutation(np.flatnonzero(problem.camera_index == 3))
    kept = np.ones(problem.num_observations, dtype=np.bool_)
    kept[rows[20:]] = False
    problem, right = problem.with_observations(kept), ~wrong[kept]
    far = sfmcpp.perturb(problem, position_sigma_m=0.5, rotation_sigma_deg=3.0, seed=seed)
    problem.cameras[3] = far.cameras[3]
    scale = sfmcpp.solve(problem, loss="auto", max_iterations=200).loss_scale_px
    weights = sfmcpp.linearize(problem, loss="auto", loss_scale_px=scale).observation_weights
    assert np.mean(weights[(problem.camera_index == 3) & right] > 0.5) > 0.9


SEEDS = (0, 1, 2)


def with_long_tails(seed: int) -> Problem:
    problem, _ = half_wrong(seed, cameras=8, points=60)
    problem.pixels[:] += 0.5 * np.random.default_rng(seed).standard_t(1.5, problem.pixels.shape)
    return problem


@pytest.mark.parametrize("seed", SEEDS)
def test_twice_the_scale_leads_to_no_lower_minimum(seed: int) -> None:
    problem = with_long_tails(seed)
    summary = sfmcpp.solve(problem, loss="auto", max_iterations=300)
    scale = summary.loss_scale_px
    sfmcpp.solve(problem, loss="truncated", loss_scale_px=2.0 * scale, max_iterations=100)
    back = sfmcpp.solve(problem, loss="truncated", loss_scale_px=scale, max_iterations=300)
    assert back.final_cost > summary.final_cost * (1.0 - 1e-5)


def test_a_run_that_ends_on_a_detour_gives_back_the_minimum_it_left() -> None:
    whole = sfmcpp.solve(with_long_tails(SEEDS[0]), loss="auto", max_iterations=300)
    scale = whole.loss_scale_px
    steps = len(whole.iterations) - 1
    ends = []
    for most in range(steps // 2, steps + 1):
        problem = with_long_tails(SEEDS[0])
        summary = sfmcpp.solve(problem, loss="auto", max_iterations=most)
        model = sfmcpp.linearize(problem, loss="auto", loss_scale_px=summary.loss_scale_px)
        assert model.cost == pytest.approx(summary.final_cost, rel=1e-12)
        ends.append((summary.loss_scale_px, summary.final_cost))
    settled = [k for k, (found, _) in enumerate(ends) if found == scale]
    assert settled == list(range(settled[0], len(ends)))
    costs = [cost for _, cost in ends[settled[0] :]]
    assert costs == sorted(costs, reverse=True)


def test_a_run_taken_up_on_a_detour_ends_with_the_same_bits(tmp_path: Path) -> None:
    whole = with_long_tails(SEEDS[0])
    steps = len(sfmcpp.solve(whole, loss="auto", max_iterations=300).iterations) - 1
    for stopped in range(steps // 2, steps, 3):
        folder = sfmcpp.CheckpointFolder(tmp_path / str(stopped))
        sfmcpp.solve(with_long_tails(SEEDS[0]), loss="auto", max_iterations=stopped, checkpoint=folder)
        problem = with_long_tails(SEEDS[0])
        sfmcpp.solve(problem, loss="auto", max_iterations=300, resume=folder)
        np.testing.assert_array_equal(problem.points, whole.points)
        np.testing.assert_array_equal(problem.cameras, whole.cameras)


def test_a_step_that_was_too_short_to_be_tried_is_not_told_as_accepted() -> None:
    problem, _ = half_wrong(3)
    summary = sfmcpp.solve(
        problem, loss="auto", max_iterations=100, parameter_tolerance=1e-9, function_tolerance=0
    )
    untried = [step for step in summary.iterations[1:] if step.cost_evaluations == 0]
    assert untried
    assert not any(step.accepted for step in untried)
