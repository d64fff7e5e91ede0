"""Costs along one step, for plots and studies of line searches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp import _core
from sfmcpp.ba.arrays import core_arrays
from sfmcpp.ba.options import SolveOptions
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, finite_array


@dataclass(frozen=True)
class StepExploration:
    """Costs along a step.

    Attributes
    ----------
    geometric : (n,) float64
        The true cost at each pair of lengths.
    algebraic : (n,) float64
        The algebraic cost there (thesis eq. 4.14); its unit is its own, and it has the weights of the true
        cost, by σ and by the loss. Of projective problems it is that in the frame of a solve (docs,
        Equations §5).
    lengths : list of float
        Common lengths at which the algebraic cost is stationary: what G-ALS proposes.
    pairs : list of (float, float)
        Pairs of lengths at which it is stationary: what T-ALS proposes.
    damping : float
        λ of the step.
    candidate : Problem
        The problem moved along the step at unit length.
    """

    geometric: FloatArray
    algebraic: FloatArray
    lengths: list[float]
    pairs: list[tuple[float, float]]
    damping: float
    candidate: Problem


@checked()
def explore_step(problem: Problem, lengths: ArrayLike, **options: Any) -> StepExploration:
    """Compute one step and evaluate the geometric and the algebraic cost along it.

    Parameters
    ----------
    problem : Problem
        Left untouched.
    lengths : (n, 2)
        Lengths of the cameras' and of the points' part of the step.
    **options
        Those of :func:`sfmcpp.solve`; `method` and `initial_damping` decide the step. It is whole: of
        `point_steps`, "auto" and "whole" alone.

    Returns
    -------
    StepExploration
        The costs, and what the algebraic line searches would propose.

    Raises
    ------
    InvalidArgument
        If the problem, an option or `lengths` breaks a rule, or there is no step.
    """
    pairs = finite_array("lengths", lengths, (ANY, 2))
    candidate, chosen = problem.copy(), SolveOptions(**options)
    if chosen.point_steps not in ("auto", "whole"):
        raise InvalidArgument(
            f"point_steps = {chosen.point_steps!r}: must be 'auto' or 'whole', as the step is whole"
        )
    found = _core.explore_step(core_arrays(candidate), chosen, pairs.tolist())
    if not found["valid"]:
        raise InvalidArgument("problem: the method has no step from here, its linear system cannot be solved")
    return StepExploration(
        np.array(found["geometric"]),
        np.array(found["algebraic"]),
        list(found["stationary_lengths"]),
        [(camera, point) for camera, point in found["stationary_pairs"]],
        found["damping"],
        candidate,
    )
