"""The steps of one run, one after the other, with the costs around each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import sfmcpp
from experiments.description import Experiment, Row
from experiments.runs import FloatArray
from experiments.starts import synthetic_starts
from sfmcpp import Problem
from sfmcpp.ba import StepExploration, explore_step

IDENTITY = ("camera_model", "iteration")
COLUMNS = (
    *IDENTITY, "geometric", "algebraic", "cost_unit", "cost_algebraic", "cost_geometric", "helps",
)  # fmt: skip
COST_NOTE = "cost_…: geometric cost there, over that at zero. helps: cost_algebraic is below cost_unit."


@dataclass(frozen=True)
class TracedStep:
    """One step of the run.

    Attributes
    ----------
    iteration : int
        Its number.
    problem : Problem
        Where it starts.
    options : dict
        Options of ``explore_step`` that make it again.
    """

    iteration: int
    problem: Problem
    options: Row

    @property
    def camera_model(self) -> str:
        """Of the problem."""
        return self.problem.camera_model

    def explore(self, lengths: FloatArray) -> StepExploration:
        """Costs at the (n, 2) lengths of cameras and points."""
        return explore_step(self.problem, lengths, **self.options)

    def row(self, algebraic: tuple[float, float], geometric: tuple[float, float]) -> Row:
        """True costs at these pairs of lengths and at the whole step, over the cost where it starts."""
        lengths = np.array([(0.0, 0.0), (1.0, 1.0), algebraic, geometric])
        start, unit, at_algebraic, at_geometric = self.explore(lengths).geometric.tolist()
        return {
            "camera_model": self.camera_model,
            "iteration": self.iteration,
            "cost_unit": unit / start,
            "cost_algebraic": at_algebraic / start,
            "cost_geometric": at_geometric / start,
            "helps": at_algebraic < unit,
        }


def traced_steps(experiment: Experiment) -> Iterator[TracedStep]:
    """The first steps from the first start, in each camera model, of the one method of the experiment.

    Each is found again from the state before it with its damping; the run itself has no line search.
    """
    (options,) = experiment.solve_options().values()
    for start in synthetic_starts(experiment):
        whole = sfmcpp.solve(start.problem.copy(), **options)
        for iteration in whole.iterations[1:]:
            problem = _state_before(start.problem, iteration.iteration, options)
            yield TracedStep(iteration.iteration, problem, {**options, "initial_damping": iteration.damping})


def sampled_lengths(experiment: Experiment) -> FloatArray:
    """The lengths at which the costs are drawn."""
    first, last = map(float, experiment.settings["range"])
    return np.linspace(first, last, int(experiment.settings["samples"]))


def _state_before(start: Problem, iteration: int, options: Row) -> Problem:
    problem = start.copy()
    if iteration > 1:
        sfmcpp.solve(problem, **{**options, "max_iterations": iteration - 1})
    return problem
