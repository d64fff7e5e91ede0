"""Bundle adjustment at given weights: one run of the minimiser, its options, checks and summary."""

from sfmcpp.ba.adjust import adjust
from sfmcpp.ba.check import check, check_jacobians, cost, residuals, residuals_px
from sfmcpp.ba.explore import StepExploration, explore_step
from sfmcpp.ba.linear_results import ConstraintRows, Covariance, LinearStep
from sfmcpp.ba.linearize import LinearModel, linearize
from sfmcpp.ba.options import GAUGES, LINE_SEARCHES, LINEAR_SOLVERS, LOSSES, METHODS, SolveOptions
from sfmcpp.ba.projective import as_projective, projection_matrices, projective_problem
from sfmcpp.ba.summary import Iteration, LinearSolverChange, LinearSolverForecast, RankLoad, Summary

__all__ = [
    "GAUGES",
    "LINEAR_SOLVERS",
    "LINE_SEARCHES",
    "LOSSES",
    "METHODS",
    "ConstraintRows",
    "Covariance",
    "Iteration",
    "LinearModel",
    "LinearSolverChange",
    "LinearSolverForecast",
    "LinearStep",
    "RankLoad",
    "SolveOptions",
    "StepExploration",
    "Summary",
    "adjust",
    "as_projective",
    "check",
    "check_jacobians",
    "cost",
    "explore_step",
    "linearize",
    "projection_matrices",
    "projective_problem",
    "residuals",
    "residuals_px",
]
