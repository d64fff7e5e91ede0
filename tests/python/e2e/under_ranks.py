"""A plugin of pytest: processes of MPI run the same tests, and every solve is one of all of them together."""

from __future__ import annotations

import functools
import os
import sys
from typing import Any

import pytest
from mpi4py import MPI

import sfmcpp

COMM = MPI.COMM_WORLD
UNKNOWNS = ("cameras", "intrinsics", "points")
solve_alone = sfmcpp.solve


@functools.wraps(solve_alone)
def solve_on_all(problem: Any, **arguments: Any) -> sfmcpp.Summary:
    """Solve the problem of rank 0 on all ranks, and give all its result."""
    if not isinstance(problem, sfmcpp.Problem):
        return solve_alone(problem, comm=COMM, **arguments)
    try:
        return solve_alone(problem if COMM.rank == 0 else None, comm=COMM, **arguments)
    finally:
        sensors = [] if problem.rigs is None else [problem.rigs.sensors]
        for array in [getattr(problem, name) for name in UNKNOWNS] + sensors:
            array[...] = COMM.bcast(array)


def pytest_configure(config: pytest.Config) -> None:
    """Let the tests find that solve, each rank in a folder of its own; rank 0 alone reports."""
    sfmcpp.solve = solve_on_all
    config.option.basetemp = f"{config.option.basetemp}-{COMM.rank}"
    if COMM.rank > 0:
        sys.stdout = open(os.devnull, "w")  # noqa: PTH123, SIM115
