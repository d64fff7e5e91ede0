"""Members of a group that its weight is chosen by, where its loss says that some may lie."""

from __future__ import annotations

import numpy as np

from sfmcpp.ba.linearize import linearize
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray
from sfmcpp.model.residual_group import Group
from sfmcpp.weighting.conflict import chi_square_median
from sfmcpp.weighting.units import ConstraintUnit

# Standard deviations, of a number, beyond which a member lies: one of 10,000 honest ones does.
LIE_SIGMAS = 4.6


def agreeing_members(
    group: Group, unit: ConstraintUnit, problem: Problem, sigma: float | None = None
) -> BoolArray:
    """Find the members that chance explains.

    Parameters
    ----------
    group : ConstraintGroup or ResidualGroup
        All members; of those without weight none is judged, and all agree.
    unit : ConstraintUnit
        Unit, spread and freedom of its kind.
    problem : Problem
        The state they are judged at.
    sigma : float, optional
        Standard deviation of a number of a member of weight one, in the unit. Default: that of which the
        median member is typical.

    Returns
    -------
    (n,) bool
        Which members are within `LIE_SIGMAS` of the state.
    """
    (rows,) = linearize(problem, constraints=[group]).groups
    squared = np.bincount(rows.member, rows.errors**2, minlength=group.num_members) * unit.spread
    if sigma is None:
        judged = np.unique(rows.member)
        variance = float(np.median(squared[judged])) / chi_square_median(unit.freedom)
    else:
        variance = sigma**2
    return np.asarray(squared <= LIE_SIGMAS**2 * unit.freedom * variance)
