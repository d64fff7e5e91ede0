"""Every method with every line search, as Python sees them."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp import InvalidArgument, Problem
from sfmcpp.ba import LINE_SEARCHES, METHODS, explore_step

FAST = [m for m in METHODS if m not in ("gradient-descent", "conjugate-gradient", "alternation")]


def scene(projective: bool = False) -> Problem:
    truth = sfmcpp.circle_scene(10, 80, pixel_sigma_px=1.0, seed=1)
    start = sfmcpp.perturb(truth, point_sigma_m=0.3, position_sigma_m=0.5, rotation_sigma_deg=5, seed=2)
    return sfmcpp.as_projective(start) if projective else start


def final_cost(problem: Problem, **options: object) -> float:
    return sfmcpp.solve(problem, function_tolerance=1e-10, **options).final_cost


@pytest.mark.parametrize("line_search", LINE_SEARCHES)
@pytest.mark.parametrize("method", FAST)
def test_second_order_methods_reach_the_minimum_with_every_line_search(method: str, line_search: str) -> None:
    reference = final_cost(scene(), method="lm")
    assert final_cost(scene(), method=method, line_search=line_search) == pytest.approx(reference, rel=1e-6)


@pytest.mark.parametrize("line_search", LINE_SEARCHES)
@pytest.mark.parametrize("method", ["lm", "lm-nielsen", "dog-leg"])
def test_projective_problems_too(method: str, line_search: str) -> None:
    reference = final_cost(scene(projective=True), method="lm")
    found = final_cost(scene(projective=True), method=method, line_search=line_search, max_iterations=200)
    assert found == pytest.approx(reference, rel=1e-5)


@pytest.mark.parametrize("line_search", ["none", "t-als", "backtracking"])
@pytest.mark.parametrize(("method", "close"), [("conjugate-gradient", 1e-2), ("alternation", 0.3)])
def test_first_order_methods_come_close(method: str, close: float, line_search: str) -> None:
    reference = final_cost(scene(), method="lm")
    found = final_cost(scene(), method=method, line_search=line_search, max_iterations=300)
    assert reference * (1 - 1e-9) <= found <= reference * (1 + close)


@pytest.mark.parametrize("line_search", ["none", "g-als", "t-als", "exact"])
def test_gradient_descent_goes_down_step_by_step(line_search: str) -> None:
    searched = {} if line_search == "none" else {"line_search_iterations": 50}
    summary = sfmcpp.solve(scene(), method="gradient-descent", line_search=line_search, **searched)
    cost = summary.history()["cost"]
    assert (np.diff(cost) <= 0).all()
    assert cost[-1] < 0.05 * cost[0]


@pytest.mark.parametrize("projective", [False, True])
def test_the_algebraic_search_proposes_what_the_exploration_of_the_step_shows(projective: bool) -> None:
    step = explore_step(scene(projective), [(0, 0), (1, 1)], method="lm")
    for search, expected in (("g-als", [(a, a) for a in step.lengths]), ("t-als", step.pairs)):
        first = sfmcpp.solve(scene(projective), method="lm", line_search=search).iterations[1]
        assert first.line_searched
        np.testing.assert_allclose(first.proposed_lengths, expected, rtol=1e-6)
        assert first.step_lengths in [(1.0, 1.0), *first.proposed_lengths]


@pytest.mark.parametrize("point_steps", ["held-back", "refitted"])
def test_a_step_that_is_explored_is_whole(point_steps: str) -> None:
    with pytest.raises(
        sfmcpp.InvalidArgument, match=f"point_steps = '{point_steps}': must be 'auto' or 'whole'"
    ):
        explore_step(scene(), [(1, 1)], point_steps=point_steps)


def test_lengths_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(sfmcpp.InvalidArgument, match=r"lengths\[1, 0\] = nan: must be finite"):
        explore_step(scene(), [(1, 1), (np.nan, 1)])


def test_exploring_a_step_gives_the_true_costs_and_leaves_the_problem() -> None:
    start = scene()
    before = start.copy()
    step = explore_step(start, [(0, 0), (1, 1), (0.5, 0.2)], method="lm")
    np.testing.assert_array_equal(start.cameras, before.cameras)
    assert step.geometric[0] == pytest.approx(sfmcpp.cost(start), rel=1e-12)
    assert step.geometric[1] == pytest.approx(sfmcpp.cost(step.candidate), rel=1e-12)
    solved = sfmcpp.solve(start, method="lm", max_iterations=1, point_steps="whole")
    assert solved.final_cost == pytest.approx(step.geometric[1], rel=1e-12)


def test_searches_stop_after_the_iterations_asked_for() -> None:
    summary = sfmcpp.solve(scene(), method="lm", line_search="exact", line_search_iterations=2)
    assert [i.line_searched for i in summary.iterations[1:]] == [
        k < 2 for k in range(len(summary.iterations) - 1)
    ]


def test_searches_can_wait_for_a_large_damping() -> None:
    far = {"line_search": "exact", "line_search_iterations": 0, "line_search_damping": 1e-4}
    summary = sfmcpp.solve(scene(), method="lm", **far)
    assert [i.line_searched for i in summary.iterations[1:]] == [
        i.damping > 1e-4 for i in summary.iterations[1:]
    ]
    assert any(i.line_searched for i in summary.iterations)


def test_searches_can_wait_for_a_rejected_step() -> None:
    truth = sfmcpp.circle_scene(10, 80, pixel_sigma_px=1.0, seed=1)
    start = sfmcpp.perturb(truth, point_sigma_m=2, position_sigma_m=3, rotation_sigma_deg=30, seed=1)
    options = {"method": "lm", "max_iterations": 30}
    plain = sfmcpp.solve(start.copy(), **options, point_steps="whole", acceleration="none")
    assert not all(i.accepted for i in plain.iterations), "the start is too easy to show anything"
    rescued = sfmcpp.solve(
        start, **options, line_search="backtracking", line_search_iterations=0, line_search_on_rejection=True
    )
    first = next(k for k, i in enumerate(plain.iterations) if not i.accepted)
    assert [i.line_searched for i in rescued.iterations[: first + 1]] == [False] * first + [True]
    assert rescued.iterations[first].accepted
    # The damping learns from the unit step, which has failed.
    dampings = [rescued.iterations[k].damping for k in (first, first + 1)]
    assert dampings[1] == pytest.approx(10 * dampings[0], rel=1e-9, abs=0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "dog-leg", "initial_damping": 1.0}, "initial_damping with method = 'dog-leg'"),
        ({"method": "lm", "initial_radius": 1.0}, "initial_radius with method = 'lm'"),
        ({"method": "alternation", "linear_solver": "sparse"}, "linear_solver = 'sparse' with method"),
        ({"line_search_on_rejection": True}, "line_search = 'none'"),
        (
            {"method": "gauss-newton", "line_search": "g-als", "line_search_damping": 1.0},
            "line_search_damping with method = 'gauss-newton'",
        ),
        ({"line_search": "g-als", "algebraic_weights": "none"}, "algebraic_weights = 'none': must be one of"),
    ],
)
def test_what_does_not_combine_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        sfmcpp.solve(scene(), **options)


@pytest.mark.parametrize("options", [{"line_search": "t-als"}, {"method": "conjugate-gradient"}])
def test_same_bits_for_every_number_of_threads(options: dict[str, str]) -> None:
    solved = []
    for threads in (1, 2, 3):
        problem = scene(projective=True)
        sfmcpp.solve(problem, threads=threads, **options)
        solved.append(problem)
    for other in solved[1:]:
        np.testing.assert_array_equal(other.cameras, solved[0].cameras)
        np.testing.assert_array_equal(other.points, solved[0].points)
