"""Evaluation of a problem without solving it: rules, residuals, cost, derivatives."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.ba.arrays import core_arrays
from sfmcpp.ba.doubtful_input import warnings_about_calibration
from sfmcpp.ba.linearize import linearize
from sfmcpp.ba.options import SolveOptions
from sfmcpp.model import LossFunction, Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.checks import require_count
from sfmcpp.model.names import Loss

# How the core names points: "point 3", "points 3, 7", "120 points (3, 7, …)".
_NAMED_POINTS = re.compile(r"^(points? |\d+ points \()(\d+(?:, \d+)*)(, …\)|)(?=: )")


def check(problem: Problem) -> list[str]:
    """Check a problem without solving it.

    Parameters
    ----------
    problem : Problem
        The problem to check.

    Returns
    -------
    list of str
        Warnings about valid but suspicious input: cameras or points without observations, points seen once,
        parts that share no point, focal lengths that are not positive, pixels far outside of the images.

    Raises
    ------
    InvalidArgument
        If the problem is invalid: the message names the array, the position, the value and the rule.
    """
    about_input = with_ids_of_points(_core.check(core_arrays(problem)), problem)
    return [*about_input, *warnings_about_calibration(problem, problem.intrinsics)]


def check_part(problem: Problem) -> None:
    """Raise InvalidArgument for broken arrays of a problem that other ranks or constraints may complete."""
    _core.check_part(core_arrays(problem))


def with_ids_of_points(warnings: Iterable[str], problem: Problem) -> list[str]:
    """Warnings of the core, with COLMAP's identifiers of the points they name where the problem has them."""

    def with_ids(found: re.Match[str]) -> str:
        numbers = [int(number) for number in found[2].split(", ")]
        ids = problem.metadata.ids_of_points(numbers, problem.num_points)
        return f"{found[0]}, {ids}{', …' * ('…' in found[3])}" if ids else found[0]

    return [_NAMED_POINTS.sub(with_ids, warning) for warning in warnings]


def residuals(problem: Problem) -> NDArray[np.float64]:
    """Residuals (observed − projected) / σ of every observation.

    Parameters
    ----------
    problem : Problem
        The problem at its present state.

    Returns
    -------
    (M, 2) float64
        In the order of the observations; pixels over standard deviations.

    Raises
    ------
    InvalidArgument
        If the problem breaks a rule.
    """
    return _core.residuals(core_arrays(problem))


def observations_without_image(problem: Problem) -> NDArray[np.intp]:
    """Numbers of observations without a finite residual: of points in the camera's centre, or beside it."""
    return np.flatnonzero(~np.isfinite(residuals(problem)).all(axis=1))


@checked()
def residuals_px(problem: Problem) -> NDArray[np.float64]:
    """Residuals observed − projected of every observation, not divided by its standard deviation.

    Parameters
    ----------
    problem : Problem
        The problem at its present state.

    Returns
    -------
    (M, 2) float64
        In the order of the observations [px].

    Raises
    ------
    InvalidArgument
        If the problem breaks a rule.
    """
    return residuals(replace(problem, sigma_px=None, covariance_px2=None))


@checked()
def cost(
    problem: Problem,
    *,
    loss: Loss | LossFunction = "squared",
    loss_scale_px: float | Literal["auto"] = 1.0,
) -> float:
    """The cost ½ Σ ρ(‖r‖²) of a problem at its present state.

    Parameters
    ----------
    problem : Problem
        The problem at its present state.
    loss, loss_scale_px
        As :func:`sfmcpp.solve` takes them.

    Returns
    -------
    float
        The cost, without constraints; with them it is that of :func:`sfmcpp.linearize`.

    Raises
    ------
    InvalidArgument
        If the problem, the loss or its scale breaks a rule.
    """
    SolveOptions(loss=loss, loss_scale_px=loss_scale_px).validate()
    if loss != "squared":
        return linearize(problem, loss=loss, loss_scale_px=loss_scale_px).cost
    r = residuals(problem)
    return 0.5 * float(np.vdot(r, r))


def check_jacobians(problem: Problem, max_observations: int = 1000) -> _core.JacobianCheck:
    """Compare analytic derivatives with numeric ones at the current state of a problem.

    Parameters
    ----------
    problem : Problem
        The problem at its present state.
    max_observations : int
        Maximum number of observations compared, spread evenly over the problem.

    Returns
    -------
    JacobianCheck
        `entries` compared, and the `worst_error` with its `worst_observation` and `worst_parameter`.

    Raises
    ------
    InvalidArgument
        If the problem breaks a rule, or `max_observations` is no whole number from 0 on.
    """
    require_count("max_observations", max_observations, at_least=0)
    return _core.check_jacobians(core_arrays(problem), max_observations)
