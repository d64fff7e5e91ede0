"""What the tests of rigs share, whether their sensors are fixed or free."""

from __future__ import annotations

from typing import Any

import numpy as np

import sfmcpp
from sfmcpp import Problem, Rigs

# One option each, with the others as they are.
WAYS_TO_SOLVE: list[dict[str, Any]] = [
    *({"linear_solver": name} for name in ("dense", "sparse", "iterative")),
    *({"method": name} for name in ("lm", "dog-leg", "gauss-newton")),
    *({"line_search": name} for name in ("g-als", "t-als", "exact", "soft", "backtracking")),
    *({"acceleration": name} for name in ("none", "points", "geodesic")),
    {"gauge": "fixed"},
    {"precision": "single"},
    {"damping_matrix": "identity"},
]


def rigs_of(problem: Problem) -> Rigs:
    assert problem.rigs is not None
    return problem.rigs


def is_rigid(problem: Problem) -> bool:
    return bool(np.abs(problem.cameras - rigs_of(problem).rigid(problem.cameras)).max() < 1e-12)


def costs_of_a_step(start: Problem) -> tuple[float, float]:
    """Costs after a step of plain Gauss-Newton from near the minimum, straight and bent."""
    straight, bent = (
        sfmcpp.solve(start.copy(), initial_damping=1e-12, acceleration=name, max_iterations=1).final_cost
        for name in ("none", "geodesic")
    )
    return straight, bent
