"""Bundle adjustment: the solve and its options, checks and summary."""

from sfmcpp.ba.explore import StepExploration, explore_step
from sfmcpp.ba.options import SolveOptions
from sfmcpp.ba.projective import as_projective, projection_matrices, projective_problem
from sfmcpp.ba.solve import (
    GAUGES,
    LINE_SEARCHES,
    LINEAR_SOLVERS,
    LOSSES,
    METHODS,
    check,
    check_jacobians,
    cost,
    residuals,
    solve,
)
from sfmcpp.ba.summary import Iteration, Summary
from sfmcpp.ba.weighing.group_selection import GroupWeightSelection
from sfmcpp.ba.weighing.selection import WEIGHT_METHODS

__all__ = [
    "GAUGES",
    "LINEAR_SOLVERS",
    "LINE_SEARCHES",
    "LOSSES",
    "METHODS",
    "WEIGHT_METHODS",
    "GroupWeightSelection",
    "Iteration",
    "SolveOptions",
    "StepExploration",
    "Summary",
    "as_projective",
    "check",
    "check_jacobians",
    "cost",
    "explore_step",
    "projection_matrices",
    "projective_problem",
    "residuals",
    "solve",
]
