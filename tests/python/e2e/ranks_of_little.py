"""What processes of MPI do whose parts are no problems alone: ``python -m mpi4py ranks_of_little.py``."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import sfmcpp
from sfmcpp.ba.parts import part_of

COMM = MPI.COMM_WORLD


def start() -> sfmcpp.Problem:
    """More unknowns of cameras than any of three ranks has residuals."""
    truth = sfmcpp.circle_scene(8, 20, camera_model="bal", pixel_sigma_px=0.5, seed=1)
    return sfmcpp.perturb(truth, point_sigma_m=0.1, seed=2)


def parts_with_few_points() -> None:
    """Dealt out by rank 0, or brought: the last rank brings nothing."""
    alone = sfmcpp.solve(start(), linear_solver="iterative")
    whole = start()
    found = sfmcpp.solve(whole if COMM.rank == 0 else None, linear_solver="iterative", comm=COMM)
    own = np.flatnonzero(np.arange(whole.num_points) % (COMM.size - 1) == COMM.rank)
    brought = sfmcpp.solve(part_of(start(), own).problem, linear_solver="iterative", comm=COMM)
    assert alone.final_cost == found.final_cost == brought.final_cost


def images_that_constraints_complete() -> None:
    """Three points in eight images determine nothing without the positions."""
    few = start().with_observations(start().point_index < 3).with_points(np.arange(3))
    few.set_free_intrinsics("f")
    group = sfmcpp.ConstraintGroup("position", np.arange(8), start().centres, sigma=0.1)
    alone = sfmcpp.solve(few.copy(), constraints=[group])
    found = sfmcpp.solve(few.copy() if COMM.rank == 0 else None, constraints=[group], comm=COMM)
    assert found.final_cost == pytest.approx(alone.final_cost, rel=1e-6)
    with pytest.raises(sfmcpp.InvalidArgument, match="fewer residuals than unknowns"):
        sfmcpp.solve(few.copy() if COMM.rank == 0 else None, comm=COMM)


if __name__ == "__main__":
    parts_with_few_points()
    images_that_constraints_complete()
