"""A trial: a copy of the problem adjusted by a robust loss, to see what remains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sfmcpp.ba import SolveOptions, Summary, adjust
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.point_tests import reprojection_errors_px
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.arrays import FloatArray

MAX_ITERATIONS = 30
# Errors are told long before the digits of the cost that send badly determined intrinsics on their way.
TOLERANCE = 1e-4
# The median of ‖r‖ of two normal coordinates, in standard deviations: √(2 ln 2).
_MEDIAN_OF_NORM = np.sqrt(2 * np.log(2))


@dataclass(frozen=True)
class Trial:
    """What an adjustment came to.

    Attributes
    ----------
    problem : Problem
        At its end.
    errors_px : (M,) float64
        Distances of the observations from the images of their points; infinite behind the camera [px].
    sigma_px : float
        Standard deviation that their median amounts to [px].
    """

    problem: Problem
    errors_px: FloatArray
    sigma_px: float

    @property
    def median_px(self) -> float:
        """Median error [px]."""
        return float(self.sigma_px * _MEDIAN_OF_NORM)


def adjust_or_stop(
    problem: Problem, constraints: Sequence[ConstraintGroup], options: SolveOptions
) -> Summary:
    """Adjust in place; Ctrl-C ends more than this one adjustment of many."""
    summary = adjust(problem, list(constraints), options)
    if summary.termination == "interrupted":
        raise KeyboardInterrupt
    return summary


def adjusted(
    problem: Problem, constraints: Sequence[ConstraintGroup] = (), loss: str = "cauchy"
) -> Trial | str:
    """Adjust a copy of `problem`, or say why that cannot be done."""
    moved = problem.copy()
    options = SolveOptions(
        loss=loss, loss_scale_px="auto", max_iterations=MAX_ITERATIONS, function_tolerance=TOLERANCE
    )
    try:
        adjust_or_stop(moved, constraints, options)
    except InvalidArgument as error:
        return str(error)
    errors = reprojection_errors_px(moved, moved.points)
    return Trial(moved, errors, float(np.median(errors) / _MEDIAN_OF_NORM))
