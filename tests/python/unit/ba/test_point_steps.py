"""Points that a step makes worse are drawn back along it; those beyond its linear model are fitted anew."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sfmcpp

MAX_STEPS = 40
# What is compared is what becomes of points, on starts that were chosen with this damping.
STRAIGHT: dict[str, Any] = {"initial_damping": 1e-4, "acceleration": "none"}


def poor_start(num_cameras: int, seed: int) -> sfmcpp.Problem:
    """A street whose points of two neighbouring images are thrown past their cameras by the first steps."""
    scene = sfmcpp.city_blocks_scene(num_cameras, seed=seed)
    return sfmcpp.perturb(scene, point_sigma_m=0.6, position_sigma_m=0.5, rotation_sigma_deg=1.0, seed=seed)


def steps_to(cost: float, summary: sfmcpp.Summary) -> int:
    return next((k for k, i in enumerate(summary.iterations) if i.cost <= cost), MAX_STEPS)


@pytest.mark.parametrize(("num_cameras", "seed"), [(30, 8), (30, 9), (30, 20), (60, 10), (60, 12)])
def test_a_few_points_do_not_delay_all_others(num_cameras: int, seed: int) -> None:
    start = poor_start(num_cameras, seed)
    options = {"max_iterations": MAX_STEPS, "function_tolerance": 1e-5, **STRAIGHT}
    whole = sfmcpp.solve(start.copy(), point_steps="whole", **options)
    held = sfmcpp.solve(start.copy(), point_steps="held-back", **options)
    goal = 1.001 * min(whole.final_cost, held.final_cost)
    assert 2 * steps_to(goal, held) <= steps_to(goal, whole)
    assert not any(i.held_points for i in whole.iterations)
    assert 0 < sum(i.held_points for i in held.iterations) < 0.1 * start.num_points


@pytest.mark.parametrize("loss", ["squared", "huber"])
def test_held_points_have_the_same_bits_for_any_number_of_threads(loss: str) -> None:
    solved = []
    for threads in (1, 2, 3):
        problem = poor_start(60, 18)
        summary = sfmcpp.solve(problem, threads=threads, loss=loss, max_iterations=8, point_steps="held-back")
        assert loss != "squared" or any(i.held_points for i in summary.iterations)
        solved.append(problem)
    for other in solved[1:]:
        np.testing.assert_array_equal(other.points, solved[0].points)
        np.testing.assert_array_equal(other.cameras, solved[0].cameras)


def test_nothing_changes_where_no_point_dissents() -> None:
    start = sfmcpp.perturb(
        sfmcpp.circle_scene(8, 200, seed=1), point_sigma_m=0.05, position_sigma_m=0.05, seed=1
    )
    whole, held = start.copy(), start.copy()
    sfmcpp.solve(whole, point_steps="whole", **STRAIGHT)
    summary = sfmcpp.solve(held, point_steps="held-back", **STRAIGHT)
    assert [i.held_points for i in summary.iterations] == [0] * len(summary.iterations)
    assert all(i.cost_evaluations <= 1 for i in summary.iterations)
    np.testing.assert_array_equal(held.points, whole.points)


@pytest.mark.parametrize(
    "options", [{"method": "gauss-newton"}, {"method": "alternation"}, {"line_search": "exact"}]
)
def test_what_cannot_hold_points_back_refuses_by_name(options: dict[str, str]) -> None:
    problem = sfmcpp.circle_scene(4, 30, seed=1)
    with pytest.raises(sfmcpp.InvalidArgument, match="point_steps = 'held-back'"):
        sfmcpp.solve(problem, point_steps="held-back", **options)


@pytest.mark.parametrize(("num_cameras", "seed"), [(30, 8), (30, 9), (60, 10), (60, 12)])
def test_refitted_points_save_steps(num_cameras: int, seed: int) -> None:
    start = poor_start(num_cameras, seed)
    options = {"max_iterations": MAX_STEPS, "function_tolerance": 1e-5, **STRAIGHT}
    held = sfmcpp.solve(start.copy(), point_steps="held-back", **options)
    refitted = sfmcpp.solve(start.copy(), **options)
    goal = 1.001 * min(held.final_cost, refitted.final_cost)
    assert steps_to(goal, refitted) < steps_to(goal, held)
    assert any(i.refitted_points for i in refitted.iterations)
    assert not any(i.refitted_points for i in held.iterations)


def test_a_minimum_is_the_same_however_points_get_there() -> None:
    start = sfmcpp.perturb(
        sfmcpp.circle_scene(8, 200, pixel_sigma_px=0.5, seed=1),
        point_sigma_m=0.1,
        position_sigma_m=0.1,
        seed=1,
    )
    ends = [
        sfmcpp.solve(start.copy(), point_steps=kind, function_tolerance=1e-14, gradient_tolerance=1e-9)
        for kind in ("whole", "held-back", "refitted")
    ]
    for end in ends[1:]:
        assert end.final_cost == pytest.approx(ends[0].final_cost, rel=1e-10)


@pytest.mark.parametrize("loss", ["squared", "huber"])
@pytest.mark.parametrize("seed", [4, 6])
def test_from_far_starts_no_point_ends_behind_its_cameras(seed: int, loss: str) -> None:
    truth = sfmcpp.corridor_scene(50, 2000, seed=seed)
    start = sfmcpp.perturb(truth, point_sigma_m=0.6, position_sigma_m=0.6, rotation_sigma_deg=2.0, seed=seed)
    options = {"loss": loss, "max_iterations": 100}
    least = sfmcpp.solve(truth, **options).final_cost
    assert sfmcpp.solve(start, **options).final_cost == pytest.approx(least, rel=1e-3)
