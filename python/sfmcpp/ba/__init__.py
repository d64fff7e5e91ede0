"""Bundle adjustment: the solve and its options, checks and summary."""

from sfmcpp.ba.options import SolveOptions
from sfmcpp.ba.solve import (
    GAUGES,
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

__all__ = [
    "GAUGES",
    "LINEAR_SOLVERS",
    "LOSSES",
    "METHODS",
    "Iteration",
    "SolveOptions",
    "Summary",
    "check",
    "check_jacobians",
    "cost",
    "residuals",
    "solve",
]
