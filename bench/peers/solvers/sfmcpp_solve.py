"""sfmcpp itself, through its Python interface."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from harness.bal_file import BalProblem, State
from harness.in_process import InProcessPeer, Solution
from harness.protocol import Job, Variant

if TYPE_CHECKING:
    import sfmcpp


class Sfmcpp(InProcessPeer):
    """``sfmcpp.solve`` with its defaults."""

    name = "sfmcpp"
    title = "sfmcpp"
    package = "sfmcpp._public"  # all of it: the package loads its parts when they are first used

    def variants(self, threads: int) -> list[Variant]:
        """As it comes: the linear solver is its own choice."""
        return [Variant("", {"linear_solver": "auto"})]

    def prepare(self, problem: BalProblem, job: Job, settings: dict[str, str]) -> Callable[[], Solution]:
        """Read the file as a user would."""
        import sfmcpp

        own = sfmcpp.read(job.bal_path)

        def solve() -> Solution:
            summary = sfmcpp.solve(
                own,
                threads=job.threads,
                max_iterations=job.rule.max_iterations,
                max_seconds=job.rule.max_seconds,
                function_tolerance=job.rule.function_tolerance,
                gradient_tolerance=0.0,
                parameter_tolerance=0.0,
                linear_solver=settings["linear_solver"],
            )
            trace = [(step.seconds, step.cost) for step in summary.iterations]
            message = f"{summary.termination}; {summary.linear_solver} linear solver"
            return Solution(trace, summary.final_cost, message, lambda: bal_state(own))

        return solve


def bal_state(problem: sfmcpp.Problem) -> State:
    """Its state in BAL's frames: camera from world, looking along −z."""
    rotations = np.diag([1.0, -1.0, -1.0]) @ problem.rotations.transpose(0, 2, 1)
    translations = -np.einsum("cij,cj->ci", rotations, problem.centres)
    return State(rotations, translations, problem.intrinsics, problem.points)


PEER = Sfmcpp()
