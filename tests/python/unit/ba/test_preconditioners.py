"""Preconditioners of conjugate gradients on a scene that is loosely connected."""

from typing import Any

import pytest

import sfmcpp
from sfmcpp.model import Problem
from sfmcpp.sources.synthetic import SCENES, perturb


@pytest.fixture(scope="module")
def street_loop() -> Problem:
    """Far ends move against one another for next to no cost."""
    truth = SCENES["street-loop"](num_cameras=200, num_points=3000, seed=3, camera_model="bal")
    return perturb(truth, seed=3, point_sigma_m=0.3, position_sigma_m=0.3, rotation_sigma_deg=1.0)


def solved(problem: Problem, **options: Any) -> sfmcpp.ba.Summary:
    return sfmcpp.solve(problem.copy(), max_iterations=5, threads=2, **options)


def test_the_coarse_space_takes_out_what_is_smooth(street_loop: Problem) -> None:
    """In steps that go as far."""
    runs = {
        kind: solved(street_loop, linear_solver="iterative", preconditioner=kind, pcg_tolerance=1e-3)
        for kind in ("clusters", "two-levels")
    }
    iterations = {
        kind: sum(step.linear_solver_iterations for step in run.iterations) for kind, run in runs.items()
    }
    assert iterations["two-levels"] < iterations["clusters"] / 3
    assert runs["two-levels"].final_cost == pytest.approx(runs["clusters"].final_cost, rel=1e-5)


def test_steps_with_it_end_where_exact_ones_do(street_loop: Problem) -> None:
    """By its own rule for the end of conjugate gradients."""
    exact = solved(street_loop, linear_solver="sparse")
    assert solved(
        street_loop, linear_solver="iterative", preconditioner="two-levels"
    ).final_cost == pytest.approx(exact.final_cost, rel=1e-4)
